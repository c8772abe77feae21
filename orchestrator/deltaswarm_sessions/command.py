"""The commands `deltaswarm session` and `verify`: their options. What they do is imported when it is done."""

import argparse
from pathlib import Path

from deltaswarm_cli.arguments import (
    Group,
    add_dry_run,
    add_json,
    add_markers,
    add_quiet,
    host_and_port,
)
from deltaswarm_sessions import AGENTS, DATASETS, IN_PROCESS, MAX_PARTICIPANT
from deltaswarm_wire.arguments import number, whole


def add_session(command: argparse.ArgumentParser) -> None:
    from deltaswarm_orchestrator.scenarios import LANGUAGES

    command.description = (
        "Run the session of one participant: the training first, then the conditions in a balanced order, each on a "
        "station's page. To continue a session that was interrupted, run the same command again."
    )
    command.add_argument("session", metavar="FILE", help="a TOML file with a table [session]")
    what = command.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--participant", type=whole(1, MAX_PARTICIPANT), metavar="N", help="number of the participant, from 1"
    )
    what.add_argument(
        "--table",
        type=Path,
        metavar="FOLDER",
        help="start no run; write the data of all participants as tables into FOLDER",
    )
    what.add_argument(
        "--plan",
        type=Path,
        metavar="FOLDER",
        help="start no run; print how many participants a study needs, computed from a pilot's tables in FOLDER "
        "(written by --table)",
    )
    what.add_argument(
        "--next", action="store_true", help="print the number of the next participant, which keeps orders balanced"
    )
    what.add_argument(
        "--withdraw",
        type=whole(1, MAX_PARTICIPANT),
        metavar="N",
        help="delete all data of this participant, also from tables; number, date and --reason stay",
    )
    what.add_argument(
        "--renumber",
        type=whole(1, MAX_PARTICIPANT),
        nargs=2,
        metavar="N",
        help="correct a participant's number, old and new; the order of the runs stays that of the old one",
    )
    what.add_argument(
        "--freeze",
        action="store_true",
        help="before the first session: commit to plan and code, and print a hash to publish, which shows neither",
    )
    command.add_argument(
        "--wide", action="store_true", help="with --table: also write wide.tsv, a row per participant, as JASP needs it"
    )
    command.add_argument(
        "--format",
        choices=DATASETS,
        action="append",
        default=[],
        help="with --table: also export a dataset in BIDS or Psych-DS into the folder of this name in FOLDER",
    )
    command.add_argument("--reason", default="", metavar="TEXT", help="with --withdraw: what to note")
    command.add_argument(
        "--pilot", action="store_true", help="work on the pilot's sessions, in the folder 'pilot' within --out"
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="folder of all sessions (default: sessions/NAME)")
    command.add_argument(
        "--language",
        metavar="LANGUAGE",
        help=f"language of the page for this participant: {', '.join(LANGUAGES)}, or a TOML file "
        "(default: session.language)",
    )
    command.add_argument(
        "--station-listen",
        type=host_and_port,
        metavar="HOST:PORT",
        help="address of the page, which is not encrypted (default: this machine only, any free port)",
    )
    add_markers(command)
    command.add_argument(
        "--agents",
        choices=AGENTS,
        default=IN_PROCESS,
        help="where agents run: in-process (default): in one process with all else, so that a killed session goes on "
        "at its step; processes: in one each, which needs more of the machine. Digests are equal",
    )
    command.add_argument(
        "--researcher",
        action="store_true",
        help="also serve a page for the experimenter that shows the truth; implies --agents processes",
    )
    add_dry_run(
        command, "the runs, their duration and what they ask (before the session has begun, in the order of the file)"
    )
    _add_question(command.add_argument_group("with --plan"))
    add_quiet(command)
    add_json(command)
    command.set_defaults(makes_files=True, handles_signals=True)


def _add_question(group: Group) -> None:
    """Add the options that say what the planned study must be able to show."""
    group.add_argument("--metric", metavar="NAME", help="a column of runs.tsv (default: all measurements)")
    group.add_argument(
        "--conditions", nargs=2, metavar="LABEL", help="the two conditions to compare, if the session has more than two"
    )
    group.add_argument(
        "--effect",
        type=number(-1e12, 1e12),
        metavar="N",
        help="difference to detect, in the unit of the metric (default: the difference in the pilot)",
    )
    group.add_argument(
        "--power", type=number(0.01, 0.99), metavar="N", help="probability of detecting the difference (default: 0.8)"
    )
    group.add_argument(
        "--alpha", type=number(1e-6, 0.5), metavar="N", help="significance level of the test (default: 0.05)"
    )
    group.add_argument(
        "--test",
        choices=("adjusted", "t", "signed-rank"),
        help="test of the differences: t-test adjusted for position and stream (default), t-test, or signed-rank test",
    )


def add_verify(command: argparse.ArgumentParser) -> None:
    """Check sessions against the published hash of their plan, and repeat their runs."""
    command.description = (
        "Check that plan and code of all sessions in a folder are those of a hash that was published before the study "
        "(deltaswarm session FILE --freeze), that no planned run is missing, and that each complete run repeats to its "
        "digest."
    )
    command.add_argument("data", type=Path, metavar="DATA", help="folder of all sessions, with the commitment")
    what = command.add_mutually_exclusive_group(required=True)
    what.add_argument("--against", metavar="HASH", help="the hash that was published")
    what.add_argument(
        "--code",
        metavar="CODE",
        help="say whose completion code this is, and whether the data are those it was made for",
    )
    add_json(command)
    command.set_defaults(func=verify)


def verify(arguments: argparse.Namespace) -> int:
    from deltaswarm_sessions import verification

    return verification.verify(arguments) if arguments.code is None else verification.verify_code(arguments)
