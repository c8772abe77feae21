"""The command `deltaswarm station`."""

import argparse
from pathlib import Path

from deltaswarm_orchestrator.base.exits import FAILED, OK, complain
from deltaswarm_orchestrator.cli.arguments import A_RUN, add_json, must_exist, show
from deltaswarm_orchestrator.processes.station import address, open_browser


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm station`."""
    command.add_argument("run", type=Path, metavar="RUN", help="the folder of a run that was started with --station")
    add_json(command)
    command.set_defaults(func=station)


def station(arguments: argparse.Namespace) -> int:
    """Print the address of the station's page of a run in progress, and open it in a browser if there is one."""
    must_exist(arguments.run, "RUN", A_RUN, or_part=True)
    under_way = arguments.run.with_name(arguments.run.name + ".part")
    url = address(under_way)
    if url is None:
        complain(f"{arguments.run}: no run with a station is under way there; see: deltaswarm replay {arguments.run}")
        return FAILED
    show(arguments, {"url": url}, url)
    open_browser(url)
    return OK
