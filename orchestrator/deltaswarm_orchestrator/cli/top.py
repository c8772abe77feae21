"""The command `deltaswarm top`."""

import argparse
import sys
from pathlib import Path

from deltaswarm_orchestrator.base.exits import FAILED, OK, USAGE, complain
from deltaswarm_orchestrator.cli.arguments import A_RUN, add_json, must_exist

INSTALL_TOP = "pip install 'deltaswarm[top]'"


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm top`."""
    command.description = (
        "Shows a run under way on the terminal: map, message rate, agents and events. Attach and leave as often as you "
        "like; the run does not notice. Shows the truth, which no operator knows. See docs/LIVE.md."
    )
    command.add_argument(
        "run", nargs="?", type=Path, metavar="RUN", help="a run's folder (default: the newest run under way from here)"
    )
    add_json(command, "one picture of the run")
    command.set_defaults(func=top)


def top(arguments: argparse.Namespace) -> int:
    """Attach to a run and show it, or print one picture of it as JSON."""
    from deltaswarm_orchestrator.top.link import NoRunError, linked

    if not arguments.json and not (sys.stdin.isatty() and sys.stderr.isatty()):
        complain("top needs a terminal; with --json it prints one picture of the run")
        return USAGE
    if arguments.run is not None:
        must_exist(arguments.run, "RUN", A_RUN, or_part=True)
    try:
        if not arguments.json:
            from deltaswarm_orchestrator.top.app import Top
        link = linked(arguments.run, Path())
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "textual":
            raise
        complain(f"top needs textual: {INSTALL_TOP}")
        return USAGE
    except NoRunError as error:
        complain(str(error))
        return FAILED
    if not arguments.json:
        Top(link).run()
        return OK
    if not link.wait():
        complain(f"{link.folder} showed nothing: it has just ended, or hangs")
        return FAILED
    print(link.as_json())
    return OK
