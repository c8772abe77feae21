"""The command `deltaswarm info`."""

import argparse
import json
from pathlib import Path

from deltaswarm_orchestrator.base.exits import OK
from deltaswarm_orchestrator.cli.arguments import A_RUN, must_exist


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm info`."""
    command.add_argument("folder", type=Path, metavar="RUN")
    command.add_argument("--json", action="store_true", help="print the result as JSON")
    command.set_defaults(func=info)


def info(arguments: argparse.Namespace) -> int:
    """Describe a run from its folder."""
    from deltaswarm_orchestrator.inspect import info

    must_exist(arguments.folder, "RUN", A_RUN)
    found = info.describe(arguments.folder)
    print(json.dumps(found) if arguments.json else info.text(found))
    return OK
