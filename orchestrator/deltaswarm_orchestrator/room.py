"""Room on the disk: an estimate before a run, a reserve for its last words, and what a full disk is called."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deltaswarm_orchestrator.exits import FAILED, CommandError
from deltaswarm_wire.exits import NO_ROOM, exit_code_of
from deltaswarm_wire.settings import Scenario

RESERVE, RESERVE_BYTES = ".reserve", 48 * 1024
"""A file that is given up at the end, so that summary and manifest can be written on a disk that is full."""

SPARE_BYTES = 16 * 1024
"""With less than this beside the reserve a part cannot even log why it fails."""

STEP_BYTES, VIEWS_BYTES, AGENT_VIEWS_BYTES, AGENT_WIRE_BYTES = 300, 300, 40, 150
"""Of tables per step; of a recording for viewers per step, and per agent and step; of raw samples the same."""


class RoomError(CommandError):
    """A file could not be written, since the disk is full or refuses; the text names it, and why."""

    code = FAILED


@contextmanager
def room_for(path: Path) -> Iterator[None]:
    """Raises RoomError for what goes wrong while this file is written."""
    try:
        yield
    except OSError as error:
        raise no_room(error, path) from None


@contextmanager
def room_in(folder: Path) -> Iterator[None]:
    """Raises RoomError for whatever the disk refuses meanwhile, in this folder unless the error names its file."""
    try:
        yield
    except OSError as error:
        if not is_refused(error):
            raise
        raise no_room(error, folder) from None


def is_refused(error: OSError) -> bool:
    """Whether the disk is at fault: full, over a quota, broken or read-only."""
    return exit_code_of(error) == NO_ROOM


def no_room(error: OSError, path: Path) -> RoomError:
    """What went wrong while this file was written."""
    return RoomError(f"{error.filename or path} could not be written: {error.strerror or error}")


def keep_reserve(folder: Path, size: int = RESERVE_BYTES) -> None:
    """Set a little room aside, or have more than before. Raises RoomError."""
    with room_for(folder):
        (folder / RESERVE).touch()
        with (folder / RESERVE).open("r+b") as file:
            os.posix_fallocate(file.fileno(), 0, size)


def check_spare(folder: Path) -> None:
    """Raises RoomError if there is no room beside the reserve."""
    keep_reserve(folder, RESERVE_BYTES + SPARE_BYTES)


def give_up_reserve(folder: Path) -> None:
    """Let the last words have it."""
    (folder / RESERVE).unlink(missing_ok=True)


def shortage(folder: Path, scenario: Scenario) -> str | None:
    """A warning, if the disk has less room than a run of this size may need."""
    agents = scenario.agents.count
    per_step = STEP_BYTES
    per_step += VIEWS_BYTES + AGENT_VIEWS_BYTES * agents if scenario.record != "off" else 0
    per_step += AGENT_WIRE_BYTES * agents if scenario.record == "wire" else 0
    needed, free = scenario.run.steps * per_step, shutil.disk_usage(folder).free
    if free >= needed:
        return None
    return f"{folder} has {free / 1e6:.0f} MB free; a run like this may need {needed / 1e6:.0f} MB"
