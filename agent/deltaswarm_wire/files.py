"""Writing of files: atomic and safe against loss of power, or secret."""

import os
from functools import partial
from pathlib import Path


def write_whole(file: Path, data: bytes, mode: int | None = None) -> None:
    """Write a file atomically; with a mode, it has this mode from the first byte on."""
    part = file.with_name(f"{file.name}.part")
    with open(part, "wb", opener=partial(os.open, mode=0o666 if mode is None else 0o600)) as stream:
        if mode is not None:
            os.fchmod(stream.fileno(), mode)
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(file)
    sync_folder(file.parent)


def write_secret(file: Path, data: bytes) -> None:
    """Write a new file that only its owner can read, from the first byte on.

    Raises:
        OSError: the file exists, or cannot be written.
    """
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
        stream.write(data)


def sync_folder(folder: Path) -> None:
    """Persist the names in a folder."""
    opened = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
