"""`deltaswarm session`: a study by link for one participant, at this machine's terminal.

This process keeps the address through all runs. Another one does the session, and goes on where it was if it is killed.
"""

import argparse
import asyncio
from math import inf
from pathlib import Path

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, OK, complain, notice
from deltaswarm_orchestrator.processes.station import ADDRESS, LOOPBACK, announce
from deltaswarm_orchestrator.scenarios.load import language_at
from deltaswarm_serving.doing import serve_front, texts_of
from deltaswarm_serving.front import Front
from deltaswarm_serving.hosting import Plan
from deltaswarm_serving.line import Line
from deltaswarm_serving.routes import OVERVIEW, PERSON, RUN, WATCHER, Site
from deltaswarm_serving.settings import ServeSettings
from deltaswarm_serving.study import Study
from deltaswarm_sessions import PROCESSES, doing, links
from deltaswarm_sessions.doing import Ready
from deltaswarm_sessions.folder import locked

LOOK_EVERY_S = 0.1


def session(arguments: argparse.Namespace) -> int:
    """Do what `deltaswarm session` does, its runs in one process unless the agents are to be processes."""
    is_by_processes = arguments.researcher or arguments.agents == PROCESSES
    return doing.session(arguments, doing.run_here if is_by_processes else _serve)


def _serve(arguments: argparse.Namespace, ready: Ready) -> int:
    """Do the session that was checked; return the exit code."""
    runner, folder = ready.runner, ready.runner.folder
    folder.mkdir(parents=True, exist_ok=True)
    locked(folder).release()  # else another command has the session
    kept = links.Links()
    link = kept.add(runner.session.participant)
    link.agreed = provenance.now()  # the sheet of the first run asks
    options = ["--sheet", "--go-on", runner.command, *["--quiet"] * arguments.quiet]
    plan = Plan(
        Path(arguments.session).resolve(),
        ready.out.resolve(),
        language_at(arguments.language or "", Path()),
        arguments.pilot,
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
            "conductor_url": f"{base}/{OVERVIEW}/{kept.overview}/{link.number}/",
        }
        notice("the page: {url}\nonly to watch it: {watch_url}\nthe conductor's page: {conductor_url}".format(**urls))
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
    if code == INTERRUPTED:
        complain(f"the session stops here; to go on: {runner.command}")
    return code
