"""`python -m deltaswarm_serving.hosted`: the process of a participant's session; another process serves its pages."""

import argparse
import socket
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from deltaswarm.errors import error_of
from deltaswarm_cli.arguments import add_markers, add_quiet
from deltaswarm_orchestrator.base.exits import show_notices
from deltaswarm_orchestrator.scenarios.load import language_at
from deltaswarm_serving.relayed import RelayedRunner
from deltaswarm_serving.runner import HostedRunner
from deltaswarm_sessions import AGENTS, PROCESSES, roster
from deltaswarm_sessions.doing import Begun, begin, kept_of
from deltaswarm_sessions.folder import folder_name
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.session import Session
from deltaswarm_sessions.settings import END, NOT_REACHED, load_session
from deltaswarm_wire.arguments import Parser, whole

SCREENED = 3
"""Exit code: the session ended since the criterion of the training was not reached."""


def parser() -> argparse.ArgumentParser:
    made = Parser(prog="python -m deltaswarm_serving.hosted", description="Do the session of one participant.")
    made.add_argument("--session", required=True, metavar="FILE", help="a TOML file with a table [session]")
    made.add_argument("--participant", type=whole(1), required=True, metavar="N", help="number of the participant")
    made.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder of all sessions")
    made.add_argument("--language", metavar="LANGUAGE", help="language of the page")
    made.add_argument("--pilot", action="store_true", help="note that the session is a pilot's")
    made.add_argument("--agents", choices=AGENTS, default=AGENTS[0], help="where agents run")
    made.add_argument("--sheet", action="store_true", help="nobody agreed at a door; the sheet asks")
    made.add_argument("--go-on", default="open the link again", metavar="TEXT", help="how an ended session goes on")
    made.add_argument("--researcher", action="store_true", help="also serve a page that shows the truth")
    add_markers(made)
    add_quiet(made)
    for name, whose in (("--channel-fd", "participant's"), ("--conductor-fd", "conductor's")):
        made.add_argument(name, type=whole(0), required=True, metavar="N", help=f"channel to the {whose} page")
    return made


def main(argv: Sequence[str] | None = None) -> int:
    arguments = parser().parse_args(argv)
    show_notices(not arguments.quiet)
    settings, beside = load_session(arguments.session)
    out, participant = arguments.out, arguments.participant
    roster.check_number(out, participant)
    begun: Begun = kept_of(settings, beside, out, participant, is_pilot=arguments.pilot)
    if arguments.language:
        settings = replace(settings, language=language_at(arguments.language, Path()))
    runs = plan(settings, begun.kept.get("allocated", participant), beside)
    is_by_processes = arguments.agents == PROCESSES
    kind = partial(RelayedRunner, researcher=arguments.researcher) if is_by_processes else HostedRunner
    runner = kind(
        session=Session(participant, runs, shows_score=settings.score, kept=begun.kept),
        folder=out / folder_name(participant),
        speed=settings.speed,
        in_process=not is_by_processes,
        markers=arguments.markers or "",
        quiet=arguments.quiet,
        command=arguments.go_on,
        has_agreed=not arguments.sheet,
        ends=(socket.socket(fileno=arguments.channel_fd), socket.socket(fileno=arguments.conductor_fd)),
    )
    runner.check()
    begin(runner, out, begun)
    code, training = runner.run(), runs[0]
    is_screened = training.criterion is not None and training.criterion.if_not_reached == END
    return SCREENED if is_screened and runner.session.outcome(training) == NOT_REACHED else code


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Exception as error:
        if (told := error_of(error, "the session")) is None:
            raise
        print(f"deltaswarm serve: {told}", file=sys.stderr)
        sys.exit(told.code)
