"""What `deltaswarm serve` does: make links, or serve a study until a signal ends it."""

import argparse
import asyncio
import logging
import re
import resource
import signal
import ssl
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any
from urllib.parse import urlsplit

from deltaswarm_cli.arguments import show
from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, OK, CommandError, notice
from deltaswarm_orchestrator.base.paths import check_files, check_out
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError
from deltaswarm_orchestrator.scenarios.load import language_at
from deltaswarm_serving.front import Front, address_of
from deltaswarm_serving.hosting import Plan
from deltaswarm_serving.line import Line
from deltaswarm_serving.routes import JOIN, OVERVIEW, Site
from deltaswarm_serving.settings import load_serve
from deltaswarm_serving.study import Study
from deltaswarm_serving.unfinished import cannot_go_on
from deltaswarm_sessions import PROCESSES, commitment, roster
from deltaswarm_sessions.folder import RECORD, folder_name, read_record
from deltaswarm_sessions.links import COMPLETE, OVER, SCREENED_OUT, Links, table
from deltaswarm_sessions.plan import PlannedRun, outline, outline_text, plan
from deltaswarm_sessions.runner import Runner
from deltaswarm_sessions.session import Session
from deltaswarm_sessions.settings import SessionSettings, load_session
from deltaswarm_sessions.trivial_questions import situation_warnings

ORIGIN = re.compile(r"https?://[^/\s;,']+")


def serve(arguments: argparse.Namespace) -> int:
    """Make links, or serve. Raises CommandError, SettingsError: something is wrong with the study or an option."""
    settings, beside = load_session(str(arguments.session))
    serving = load_serve(str(arguments.session))
    if arguments.robots is not None and not arguments.pilot:
        raise CommandError("--robots must be given with --pilot: what robots do is no data of the study")
    site = _site(arguments)
    out: Path = arguments.out or Path("sessions") / arguments.session.stem
    out = out / roster.PILOT if arguments.pilot else out
    check_files(out)
    check_out(out)
    _, warnings = commitment.check_plan(settings, beside, out)
    if arguments.language:
        settings = replace(settings, language=language_at(arguments.language, Path()))
    [first, *_] = runs = plan(settings, 1, beside)
    checked = Runner(session=Session(1, runs), folder=out / folder_name(1), speed=settings.speed)
    for warning in [*warnings, *checked.check(), *(situation_warnings(runs) if arguments.dry_run else ())]:
        notice(warning)
    places = serving.places(settings.speed, by_processes=arguments.agents == PROCESSES)
    if arguments.dry_run:
        outlined = outline(settings, runs, is_concealed=True) | {"at_once": places}
        show(arguments, outlined, f"{outline_text(outlined)}\nSessions at once: {places}.")
        return OK
    out.mkdir(parents=True, exist_ok=True)
    with _alone(out):
        links = Links.read(out)
        if arguments.links is not None:
            return _make_links(arguments, settings, out, links, site)
        if not arguments.restart_runs:
            _check_unfinished(settings, beside, out, links)
        links.write(out)
        most = max(serving.per_address, arguments.robots or 0)  # they all come from this machine
        study = Study(
            settings,
            replace(serving, per_address=most),
            Plan(
                arguments.session.absolute(),
                out.resolve(),
                language_at(arguments.language, Path()),
                arguments.pilot,
                arguments.share,
                is_by_processes=arguments.agents == PROCESSES,
            ),
            links,
            Line(places),
        )
        tls = _tls(arguments.certificate, arguments.key)
        front = Front(study, site, texts_of(first))

        async def meanwhile(here: str) -> int:
            base = site.public or here
            paths = {"open link": f"{JOIN}/{links.join}", "overview": f"{OVERVIEW}/{links.overview}"}
            addresses = {name: f"{base}/{path}/" for name, path in paths.items()}
            show(arguments, addresses, "\n".join(f"{name}: {address}" for name, address in addresses.items()))
            notice(
                f"{study.line.at_once} sessions at once; Ctrl-C ends the service, and what is under way goes on later"
            )
            if not arguments.robots:
                return OK
            return await _rehearse(front, f"{here}/{JOIN}/{links.join}/", arguments.robots)

        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
        return serve_front(front, arguments.listen, tls, meanwhile, if_stopped=OK)


def _check_unfinished(settings: SessionSettings, beside: Path, out: Path, links: Links) -> None:
    """Refuse a service that cannot go on where its participants are."""
    found = []
    for number in sorted(link.number for link in links.links if link.number and link.state not in OVER):
        folder = out / folder_name(number)
        if not any(folder.glob("*.journal")):
            continue
        allocated = read_record(folder).get("allocated", number) if (folder / RECORD).exists() else number
        runs = cannot_go_on(folder, plan(settings, allocated, beside), settings.speed)
        found += [f"{folder.name}/{run}" for run in runs]
    if found:
        raise CommandError(
            f"runs under way must be of the same code and files, but these were begun by others: {', '.join(found)}; "
            "let their participants finish with the version that began them, or do the runs again by --restart-runs"
        )


def _make_links(arguments: argparse.Namespace, settings: SessionSettings, out: Path, links: Links, site: Site) -> int:
    for _ in range(arguments.links):
        with roster.held(out):
            number: int = roster.next_number(settings, out, links.numbers, arguments.share)["next"]
        links.add(number)
    links.write(out)
    base = site.public or address_of(arguments.listen, arguments.certificate)
    rows = table(links.links, f"{base}/")
    show(
        arguments,
        rows,
        "\n".join(["number,state,address", *(f"{r['number']},{r['state']},{r['address']}" for r in rows)]),
    )
    return OK


def texts_of(first: PlannedRun) -> dict[str, Any]:
    page = first.scenario.operator.page
    return {
        "title": page.title or first.scenario.name,
        "consent": first.scenario.operator.probes.consent,
        "language": page.language.told,
    }


def _site(arguments: argparse.Namespace) -> Site:
    public = urlsplit(arguments.public)
    if arguments.public and (public.scheme not in ("http", "https") or not public.netloc or public.query):
        raise CommandError(
            f"--public must be an address such as https://study.example.org/swarm (got {arguments.public})"
        )
    if arguments.embed and not ORIGIN.fullmatch(arguments.embed):
        raise CommandError(f"--embed must be an origin such as https://survey.example.org (got {arguments.embed})")
    if (arguments.certificate is None) != (arguments.key is None):
        raise CommandError("--certificate and --key must be given together")
    host = arguments.listen.rpartition(":")[0].strip("[]")
    return Site(host, arguments.public.rstrip("/"), arguments.embed, arguments.certificate is not None)


def _tls(certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    if certificate is None:
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise CommandError(f"--certificate {certificate} and --key {key} must be a pair in PEM: {error}") from None
    return context


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Hold a study, so that one service at a time has it."""
    logs = out / "logs"
    logs.mkdir(exist_ok=True)
    try:
        lock = FolderLock(logs)
    except HeldError:
        raise CommandError(f"{out} must be free: another `deltaswarm serve` is at work there", FAILED) from None
    try:
        yield
    finally:
        lock.release()


def serve_front(
    front: Front,
    listen: str,
    tls: ssl.SSLContext | None,
    meanwhile: Callable[[str], Coroutine[Any, Any, int]],
    *,
    if_stopped: int = INTERRUPTED,
) -> int:
    """Serve until the front is stopped, by a signal or by `meanwhile`, which gets the address; return the exit code.

    It is what `meanwhile` returns, or `if_stopped` if that has not come to its end.
    """
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # each page takes a few
    host, _, port = listen.rpartition(":")
    tasks: list[asyncio.Task[int]] = []

    def ready(port: int) -> None:
        here = address_of(f"{host}:{port}", tls)
        tasks.append(asyncio.get_running_loop().create_task(meanwhile(here)))
        tasks[0].add_done_callback(lambda task: None if task.cancelled() or not task.exception() else front.stop())

    async def run() -> int:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, front.stop)
        await front.run(host.strip("[]"), int(port), tls, ready)
        return tasks[0].result() if tasks[0].done() else if_stopped

    try:
        return asyncio.run(run())
    except OSError as error:
        raise CommandError(f"cannot listen at {listen}: {error}", FAILED) from None


async def _rehearse(front: Front, open_link: str, count: int) -> int:
    """Let robots take part, then stop the service; return FAILED if one did not come to an end that a study has."""
    from deltaswarm_serving.robots import Robot  # few services have any

    outside = front.study.settings.outside_id
    links = [f"{open_link}?{outside}=robot-{number}" if outside else open_link for number in range(1, count + 1)]
    states = await asyncio.gather(*(Robot(link, Random(link + str(n))).take_part() for n, link in enumerate(links)))
    for state, sum_of in sorted(Counter(states).items()):
        notice(f"robots {state}: {sum_of}")
    front.stop()
    return OK if all(state in (COMPLETE, SCREENED_OUT) for state in states) else FAILED
