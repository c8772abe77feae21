"""What `deltaswarm run` has for agents on boards."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_wire.arguments import agent_numbers
from deltaswarm_wire.checked import Problem, SettingsError

if TYPE_CHECKING:
    from deltaswarm_orchestrator.boards.boards import Boards


def add_hardware_in_the_loop(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm run` for agents that are started elsewhere."""
    command.add_argument(
        "--boards",
        type=agent_numbers,
        metavar="N-M,...",
        help="agents that run on boards: wait for them instead of starting them",
    )
    command.add_argument(
        "--boards-folder",
        type=Path,
        metavar="FOLDER",
        help="where to put the files for each board (default: RUN.boards)",
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
    from deltaswarm_orchestrator.boards.boards import Boards

    folder = arguments.boards_folder or out.with_name(f"{out.name}.boards")
    return Boards(tuple(arguments.boards), arguments.listen, folder)
