"""`deltaswarm info`."""

import argparse
import json
from pathlib import Path

from deltaswarm_orchestrator.exits import OK, USAGE, complain


def add(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm info`."""
    command.add_argument("folder", type=Path, metavar="RUN")
    command.add_argument("--json", action="store_true", help="print the result as JSON")
    command.set_defaults(func=info)


def info(arguments: argparse.Namespace) -> int:
    """Describe a run from its folder."""
    from deltaswarm_orchestrator.run import info

    if not arguments.folder.is_dir():
        unfinished = arguments.folder.with_name(f"{arguments.folder.name}.part")
        allowed = f"{unfinished} has what was left of a run" if unfinished.is_dir() else "a run folder is expected"
        complain(f"{arguments.folder} is not a folder; {allowed}")
        return USAGE
    try:
        found = info.describe(arguments.folder)
    except info.NotARunError as error:
        complain(str(error))
        return USAGE
    print(json.dumps(found) if arguments.json else info.text(found))
    return OK
