"""The command `deltaswarm replay`."""

import argparse
import importlib
import tempfile
from pathlib import Path

from deltaswarm_orchestrator.base.exits import USAGE, complain
from deltaswarm_orchestrator.cli.arguments import A_RUN, host_and_port, must_exist


def add(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm replay`."""
    command.add_argument("run", type=Path, metavar="RUN", help="the folder of a run, finished or not, with a recording")
    command.add_argument(
        "--listen",
        type=host_and_port,
        default="127.0.0.1:0",
        metavar="HOST:PORT",
        help="where the page is served (default: any free port)",
    )
    command.set_defaults(func=replay)


def replay(arguments: argparse.Namespace) -> int:
    """Serve the station's page from a recording, until Ctrl-C."""
    from deltaswarm_orchestrator.recording.reader import RecordingError
    from deltaswarm_orchestrator.recording.replay import write_steps

    must_exist(arguments.run, "RUN", A_RUN)
    with tempfile.TemporaryDirectory(prefix="deltaswarm-replay-") as folder:
        steps = Path(folder) / "steps.msgpack"
        try:
            write_steps(arguments.run, steps)
        except (RecordingError, OSError) as error:
            complain(f"{arguments.run}: {error}")
            return USAGE
        replaying = importlib.import_module("deltaswarm_operator.io.replaying")
        code: int = replaying.main([str(steps), "--run", arguments.run.name, "--listen", arguments.listen])
    return code
