"""Arguments that several commands share."""

import argparse
import json
from typing import Any

from deltaswarm_orchestrator.base.output import print_result
from deltaswarm_orchestrator.processes.elsewhere import LOCAL
from deltaswarm_wire.extras import missing

A_RUN = "the folder of a run"


Group = argparse._ActionsContainer
"""A parser, or a group of its arguments."""


def add_dry_run(command: Group, prints: str) -> None:
    """Add `--dry-run`: every check of a run, without the run."""
    command.add_argument(
        "--dry-run", action="store_true", help=f"start and write nothing: make every check, and print {prints}"
    )


def add_engine(command: Group, scheduler: str) -> None:
    """Add `--engine` and `--scheduler`, whose help says what the scheduler is for."""
    command.add_argument(
        "--engine",
        metavar="NAME",
        default=LOCAL,
        help="local: this machine (default); python or dense: runs in one process, by this engine alone; dask: a Dask "
        "cluster; or an engine of an installed package",
    )
    command.add_argument("--scheduler", metavar="ADDRESS", help=f"with --engine dask: {scheduler}")


def add_json(command: Group, what: str = "the result") -> None:
    command.add_argument("--json", action="store_true", help=f"print {what} as one JSON document")


def add_quiet(command: Group) -> None:
    command.add_argument("-q", "--quiet", action="store_true", help="print no progress and no notices, only errors")


def show(arguments: argparse.Namespace, result: Any, text: str) -> None:
    print_result(json.dumps(result) if arguments.json else text)


def add_markers(command: Group) -> None:
    command.add_argument(
        "--markers",
        type=_markers,
        metavar="HOST:PORT|lsl",
        help="send what the person does and is asked to other instruments as it happens: JSON lines to every client "
        "that connects to HOST:PORT, or an LSL marker stream (extra lsl)",
    )


def _markers(text: str) -> str:
    if text == "lsl":
        if needs := missing("pylsl"):
            raise argparse.ArgumentTypeError(f"lsl {needs}")
    elif host_and_port(text).endswith(":0"):
        raise argparse.ArgumentTypeError(f"must be lsl, or HOST:PORT with a port from 1 to 65535 (got {text!r})")
    return text


def host_and_port(text: str) -> str:
    """Check where a page is to be served, for `type=`."""
    from deltaswarm_wire import session

    try:
        session.host_and_port(f"tcp/{text}")
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be HOST:PORT with a port from 0 to 65535 (got {text!r})") from None
    return text
