"""The command `deltaswarm export`."""

import argparse
from pathlib import Path

from deltaswarm_orchestrator.base.exits import FAILED, OK, complain, notice
from deltaswarm_orchestrator.cli.arguments import A_RUN, add_json, add_quiet, must_exist, show

FORMATS = ("csv", "rosbag2", "rrd", "mp4")


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm export`."""
    command.description = "Exports the recording of a run, also of one that was cut off. See docs/RECORDING.md."
    command.add_argument("run", type=Path, metavar="RUN", help="a run's folder, or an MCAP recording")
    command.add_argument("--format", choices=FORMATS, required=True, help="tables, ROS 2 bag, Rerun, or video")
    command.add_argument("--out", type=Path, help="file or folder to write (default: beside the run)")
    command.add_argument("--force", action="store_true", help="replace an earlier export")
    add_quiet(command)
    add_json(command)
    command.set_defaults(func=export)


def export(arguments: argparse.Namespace) -> int:
    """Export a recording, and print where it is."""
    from deltaswarm_orchestrator.export import formats as exporting

    must_exist(arguments.run, "RUN", f"{A_RUN}, or an MCAP recording")
    out = arguments.out or exporting.default_out(arguments.run, arguments.format)
    try:
        complete = exporting.export(arguments.run, arguments.format, out, force=arguments.force)
    except OSError as error:
        complain(f"{error.filename or out} could not be written: {error.strerror or error}")
        return FAILED
    if not complete:
        notice(f"the recording of {arguments.run} is incomplete; what it holds is exported")
    show(arguments, {"out": str(out), "complete": complete}, str(out))
    return OK
