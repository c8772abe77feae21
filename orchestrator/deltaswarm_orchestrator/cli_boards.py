"""What the command line has for agents on boards: `bundle`, `certificates`, and `run --boards`."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_orchestrator.exits import FAILED, OK, USAGE, complain
from deltaswarm_wire import __version__
from deltaswarm_wire.arguments import agent_numbers
from deltaswarm_wire.checked import Problem, SettingsError

if TYPE_CHECKING:
    from deltaswarm_orchestrator.boards import Boards

MAX_DAYS = 36_500


def add_bundle(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm bundle`."""
    from deltaswarm_orchestrator.bundle import PLATFORMS, PYTHONS

    command.description = "Make a folder from which an agent is installed on a board without internet."
    command.add_argument("--platform", required=True, choices=PLATFORMS, help="the board's")
    command.add_argument(
        "--python", action="append", choices=PYTHONS, help="the board's; may be repeated (default: all of these)"
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: deltaswarm-agent-VERSION-PLATFORM")


def add_certificates(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm certificates`."""
    command.description = (
        "Make an authority and certificates signed by it, for the world, the operator, the recorder and each agent. "
        "A folder that holds some already is added to."
    )
    command.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="for NAME.pem and NAME.key")
    command.add_argument("--agents", type=agent_numbers, required=True, metavar="N-M,...", help="such as 20-24 or 3,7")
    command.add_argument(
        "--host", action="append", default=[], metavar="HOST", help="name or address of the world's machine; repeatable"
    )
    command.add_argument("--days", type=_days, default=365, metavar="N", help="how long they are valid (default: 365)")


def add_hardware_in_the_loop(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm run` for agents that are started elsewhere."""
    command.add_argument(
        "--boards", type=agent_numbers, metavar="N-M,...", help="agents on boards: not started, but waited for"
    )
    command.add_argument(
        "--boards-folder", type=Path, metavar="FOLDER", help="for what each board is given (default: RUN.boards)"
    )


def boards_of(arguments: argparse.Namespace, out: Path) -> "Boards | None":
    """The boards of a run into the folder `out`, if it has any.

    Raises:
        SettingsError: a folder for them without them, or boards in a run in one process.
    """
    if not arguments.boards:
        if arguments.boards_folder:
            raise SettingsError([Problem("--boards-folder", str(arguments.boards_folder), "only with --boards")])
        return None
    if arguments.in_process:
        raise SettingsError([Problem("--boards", "with --in-process", "boards are processes of their own")])
    from deltaswarm_orchestrator.boards import Boards

    folder = arguments.boards_folder or out.with_name(f"{out.name}.boards")
    return Boards(tuple(arguments.boards), arguments.listen, folder)


def bundle(arguments: argparse.Namespace) -> int:
    """`deltaswarm bundle`."""
    from deltaswarm_orchestrator import bundle as bundles

    out = arguments.out or Path(f"deltaswarm-agent-{__version__}-{arguments.platform}")
    pythons = sorted(set(arguments.python or bundles.PYTHONS), key=bundles.PYTHONS.index)
    try:
        names = bundles.bundle(out, arguments.platform, pythons)
    except bundles.BundleError as error:
        complain(str(error))
        return FAILED
    print("\n".join([*(f"  {name}" for name in names), str(out)]))
    return OK


def certificates(arguments: argparse.Namespace) -> int:
    """`deltaswarm certificates`."""
    from deltaswarm_orchestrator.certificates import make

    try:
        files = make(arguments.out, arguments.agents, arguments.host, arguments.days)
    except (ValueError, OSError) as error:
        complain(str(error))
        return USAGE
    print("\n".join(map(str, files)) if files else f"{arguments.out}: all of them are there")
    print(
        f"{arguments.out / 'ca.key'} signs for everybody: it stays on this machine. "
        "A board gets ca.pem, its own .pem and its own .key",
        file=sys.stderr,
    )
    return OK


def _days(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= MAX_DAYS:
        raise argparse.ArgumentTypeError(f"{text!r}: 1 to {MAX_DAYS} days are allowed")
    return int(text)
