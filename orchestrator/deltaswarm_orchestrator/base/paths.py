"""Paths that a user gives: what must be there, what can be written, and which folder is free."""

import os
from itertools import chain, count
from pathlib import Path

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.checked import did_you_mean


def free_folder(folder: Path) -> Path:
    """Return the folder, or its name with a number if a run has it; an interrupted run keeps its folder, too."""
    numbered = (folder.with_name(f"{folder.name}-{number}") for number in count(2))
    free = (path for path in chain([folder], numbered) if not path.exists() and not part_of(path).exists())
    return next(free)


def check_out(folder: Path) -> None:
    """Check that a folder, which need not exist, can be made and written, by a file without a name.

    Raises:
        CommandError: it cannot.
    """
    import tempfile  # which the options of a command need not load

    nearest = next((path for path in (folder, *folder.absolute().parents) if os.path.lexists(path)), folder)
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise CommandError(
            f"--out must be a folder that can be made and written (got {str(folder)!r}; {nearest}: {error.strerror})"
        ) from None


def part_of(run: Path) -> Path:
    """Return where a run is until it is complete."""
    return run.with_name(f"{run.name}.part")


def must_exist(path: Path, name: str, what: str, *, or_part: bool = False) -> None:
    """Check that there is something at a path; the message says where it was looked for.

    With `or_part` it may also be at PATH.part, where a run is until it is complete.

    Raises:
        CommandError: there is nothing.
    """
    part = part_of(path) if path.name else path
    has_part = os.path.exists(part)  # unlike `Path.exists`, False for an impossible name
    if os.path.exists(path) or (or_part and has_part):
        return
    hint = f"; {part} has what is left of an interrupted run" if has_part else ""
    if not hint and path.parent.is_dir():
        near = did_you_mean(path.name, (other.name for other in path.parent.iterdir()))
        hint = near and f"; {near.strip()}"
    raise CommandError(f"{name} must be {what} (got {str(path)!r}; there is nothing at {path.absolute()}{hint})")
