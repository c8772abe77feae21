"""Writing of files: atomic and safe against loss of power, or secret."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import BinaryIO


class Written:
    """The whole files that this process wrote since the command began, for the message about one that it could not."""

    count = 0
    last = ""

    @classmethod
    def begin(cls) -> None:
        """Forget what was written before."""
        cls.count, cls.last = 0, ""

    @classmethod
    def summary(cls) -> str:
        """Say in a few words which files were written."""
        match cls.count:
            case 0:
                return "nothing was written"
            case 1:
                return f"only {cls.last} was written"
        return f"{cls.count} files were written before it, the last is {cls.last}"


@contextmanager
def naming(file: Path) -> Iterator[None]:
    """Give an OSError the name of the file that is written, which Python leaves out of errors of open files."""
    try:
        yield
    except OSError as error:
        if error.filename not in (None, f"{file}.part"):
            raise
        raise OSError(error.errno, error.strerror or str(error), str(file)) from error


@contextmanager
def replacing(file: Path, mode: int | None = None) -> Iterator[BinaryIO]:
    """Open a file for writing that replaces `file` once the block ends, and is deleted if it cannot be written.

    With a mode, it has this mode from the first byte on.
    """
    part = file.with_name(f"{file.name}.part")
    with naming(file):
        try:
            with open(part, "wb", opener=partial(os.open, mode=0o666 if mode is None else 0o600)) as stream:
                if mode is not None:
                    os.fchmod(stream.fileno(), mode)
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            part.replace(file)
        except OSError:
            with suppress(OSError):
                part.unlink()
            raise
    Written.count, Written.last = Written.count + 1, str(file)
    sync_folder(file.parent)


def write_whole(file: Path, data: bytes, mode: int | None = None) -> None:
    """Write a file atomically, as `replacing` does."""
    with replacing(file, mode) as stream:
        stream.write(data)


@contextmanager
def whole_or_none(folder: Path) -> Iterator[None]:
    """Remove a new folder that the block cannot fill."""
    try:
        yield
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        Written.begin()
        raise


def write_secret(file: Path, data: bytes) -> None:
    """Write a new file that only its owner can read, from the first byte on."""
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with naming(file), os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
    except OSError:
        file.unlink()  # half a secret would pass for one that exists
        raise


def sync_folder(folder: Path) -> None:
    """Persist the names in a folder."""
    opened = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
