"""Disk space: estimate it before a run, reserve some for the results, and report a full disk."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_wire.child import NO_ROOM, exit_code_of

if TYPE_CHECKING:  # a message about a full disk must not wait for the settings to load
    from deltaswarm_scenario.scenario import Scenario

RESERVE, RESERVE_BYTES = ".reserve", 48 * 1024
"""A file that is deleted at the end, so that summary and manifest can be written on a full disk."""

SPARE_BYTES = 16 * 1024
"""With less than this besides the reserve, a part cannot even log why it fails."""

STEP_BYTES, VIEWS_BYTES, AGENT_VIEWS_BYTES, AGENT_WIRE_BYTES = 300, 300, 40, 150
"""Sizes: tables per step; recording for viewers per step, and per agent and step; raw samples per agent and step."""


class RoomError(CommandError):
    """A file could not be written because the disk is full or faulty; the text names the file and the reason."""

    code = FAILED


@contextmanager
def room_for(path: Path) -> Iterator[None]:
    """Turn any OSError while this file is written into RoomError."""
    try:
        yield
    except OSError as error:
        raise no_room(error, path) from None


@contextmanager
def room_in(folder: Path) -> Iterator[None]:
    """Turn disk errors into RoomError, which names this folder unless the error names a file."""
    try:
        yield
    except OSError as error:
        if not is_refused(error):
            raise
        raise no_room(error, folder) from None


def is_refused(error: OSError) -> bool:
    """Return whether the disk is at fault: full, over quota, broken or read-only."""
    return exit_code_of(error) == NO_ROOM


def no_room(error: OSError, path: Path) -> RoomError:
    return RoomError(f"{error.filename or path} could not be written: {error.strerror or error}")


def keep_reserve(folder: Path, size: int = RESERVE_BYTES) -> None:
    """Reserve disk space, or enlarge the reserve. Raises RoomError."""
    with room_for(folder):
        (folder / RESERVE).touch()
        with (folder / RESERVE).open("r+b") as file:
            os.posix_fallocate(file.fileno(), 0, size)


def check_spare(folder: Path) -> None:
    """Raise RoomError if there is no spare room besides the reserve."""
    keep_reserve(folder, RESERVE_BYTES + SPARE_BYTES)


def give_up_reserve(folder: Path) -> None:
    """Delete the reserve, so that the final results have room."""
    (folder / RESERVE).unlink(missing_ok=True)


def shortage(folder: Path, scenario: "Scenario") -> str | None:
    """Return a warning if the disk has less room than a run of this size may need, else None."""
    agents = scenario.agents.count
    per_step = STEP_BYTES
    per_step += VIEWS_BYTES + AGENT_VIEWS_BYTES * agents if scenario.record != "off" else 0
    per_step += AGENT_WIRE_BYTES * agents if scenario.record == "wire" else 0
    needed, free = scenario.run.steps * per_step, shutil.disk_usage(folder).free
    if free >= needed:
        return None
    return f"{folder} has {_shown(free)} free; a run like this may need {_shown(needed)}"


def _shown(size: float) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e7 else f"{size / 1e3:.0f} kB"
