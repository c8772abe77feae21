"""`deltaswarm session`: a study by link for one participant, at this machine's terminal.

This process keeps the address through all runs. Another one does the session, and goes on where it was if it is killed.
"""

import argparse
import asyncio
from math import inf
from pathlib import Path
from shutil import rmtree

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, OK, complain, notice
from deltaswarm_orchestrator.processes.station import ADDRESS, LOOPBACK, announce
from deltaswarm_orchestrator.results.folder_lock import LOCK_FILES
from deltaswarm_orchestrator.scenarios.load import language_at
from deltaswarm_serving.doing import serve_front, texts_of
from deltaswarm_serving.front import Front
from deltaswarm_serving.hosting import Plan
from deltaswarm_serving.line import Line
from deltaswarm_serving.routes import OVERVIEW, PERSON, RUN, WATCHER, Site
from deltaswarm_serving.settings import ServeSettings
from deltaswarm_serving.study import Study
from deltaswarm_sessions import doing, links
from deltaswarm_sessions.doing import Ready
from deltaswarm_sessions.folder import locked

LOOK_EVERY_S = 0.1


def session(arguments: argparse.Namespace) -> int:
    """Do what `deltaswarm session` does."""
    return doing.session(arguments, serve)


def serve(arguments: argparse.Namespace, ready: Ready) -> int:
    """Do the session that was checked; return the exit code."""
    runner, folder = ready.runner, ready.runner.folder
    folder.mkdir(parents=True, exist_ok=True)
    locked(folder).release()  # else another command has the session
    kept = links.Links()
    link = kept.add(runner.session.participant)
    link.agreed = provenance.now()  # the sheet of the first run asks
    options = ["--sheet", "--go-on", runner.command]
    options += ["--quiet"] * arguments.quiet + ["--researcher"] * arguments.researcher
    plan = Plan(
        Path(arguments.session).absolute(),
        ready.out.resolve(),
        language_at(arguments.language or "", Path()),
        arguments.pilot,
        is_by_processes=not runner.in_process,
        options=(*options, *(["--markers", arguments.markers] if arguments.markers else [])),
        terminal=(2 if arguments.json else 1, 2),
    )
    always = ServeSettings(at_once=1, absent_after_s=inf)
    study = Study(ready.settings, always, plan, kept, Line(1), has_doors=False)
    listen = arguments.station_listen or LOOPBACK
    front = Front(study, Site(listen.rpartition(":")[0].strip("[]")), texts_of(runner.session.runs[0]))

    async def to_the_end(base: str) -> int:
        urls = {
            "url": f"{base}/{PERSON}/{link.token}/{RUN}/",
            "watch_url": f"{base}/{WATCHER}/{kept.watchers(link)}/",
        }
        notice("the page: {url}\nonly to watch it: {watch_url}".format(**urls))
        if not arguments.researcher:  # else it is another one, which shows the truth
            urls["conductor_url"] = f"{base}/{OVERVIEW}/{kept.overview}/{link.number}/"
            notice(f"the conductor's page: {urls['conductor_url']}")
        announce(folder, urls, opens_browser=True)
        study.agree(link)
        while link.state not in (*links.OVER, links.FAILED):
            await asyncio.sleep(LOOK_EVERY_S)
        front.stop()
        ends = {links.COMPLETE: OK, links.SCREENED_OUT: FAILED}
        code = study.host(link).code
        return ends.get(link.state, INTERRUPTED if code is None or code < 0 else code)

    try:
        code = serve_front(front, listen, None, to_the_end)
    finally:
        (folder / ADDRESS).unlink(missing_ok=True)
        if {path.name for path in folder.iterdir()} <= LOCK_FILES:  # it has not begun
            rmtree(folder)
    if code == INTERRUPTED:
        complain(f"the session stops here; to go on: {runner.command}")
    return code
