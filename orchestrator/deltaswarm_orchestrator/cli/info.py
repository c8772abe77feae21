"""The command `deltaswarm info`."""

import argparse
from pathlib import Path

from deltaswarm_orchestrator.base.exits import OK
from deltaswarm_orchestrator.cli.arguments import A_RUN, add_json, must_exist, show


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm info`."""
    command.add_argument("folder", type=Path, metavar="RUN")
    add_json(command)
    command.set_defaults(func=info)


def info(arguments: argparse.Namespace) -> int:
    """Describe a run from its folder."""
    from deltaswarm_orchestrator.inspect import info

    must_exist(arguments.folder, "RUN", A_RUN)
    found = info.describe(arguments.folder)
    show(arguments, found, info.text(found))
    return OK
