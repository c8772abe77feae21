"""Temporary folders; a command removes those that killed processes left behind."""

import fcntl
import os
import re
import secrets
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from deltaswarm_wire.files import Written

PREFIX = ".deltaswarm-"


class TemporaryFolder:
    """A folder that only this user can read, as a context manager; it is deleted with the object at the latest.

    It is locked for as long, so that others can tell whether its process has been killed.

    Args:
        parent: where it is made; None: where the system has temporary files.
    """

    def __init__(self, parent: Path | None = None) -> None:
        parent = Path(tempfile.gettempdir()) if parent is None else parent
        remove_left(parent)
        self.path, lock = locked_folder(parent)
        self.close = weakref.finalize(self, _remove, self.path, lock)

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """Yield a folder beside `out`, which becomes `out` when it is complete; nothing is left of one that is not."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryFolder(out.parent) as scratch:
        (folder := scratch / out.name).mkdir()
        try:
            yield folder
            folder.rename(out)
        except OSError as error:
            Written.begin()
            name = os.fsdecode(error.filename or "")
            raise OSError(error.errno, error.strerror or str(error), name.replace(str(folder), str(out))) from error


def locked_folder(parent: Path, prefix: str = PREFIX) -> tuple[Path, int]:
    """Make a folder of mode 0700, and lock it; return it with the lock's descriptor."""
    unlocked = Path(tempfile.mkdtemp(prefix=f"{prefix}new-", dir=parent))
    lock = os.open(unlocked, os.O_RDONLY)
    with suppress(OSError):  # a file system without locks, on which `remove_left` removes nothing
        fcntl.flock(lock, fcntl.LOCK_EX)
    # It gets the name by which `remove_left` finds it when the lock is held.
    return unlocked.rename(unlocked.with_name(f"{prefix}{secrets.token_hex(8)}")), lock


def remove_left(parent: Path, prefix: str = PREFIX) -> None:
    """Remove this user's folders in `parent` whose processes were killed, so that they could not."""
    pattern = re.compile(rf"{re.escape(prefix)}[0-9a-f]{{16}}")
    for folder in (path for path in parent.glob(f"{prefix}*") if pattern.fullmatch(path.name)):
        with suppress(OSError):  # another user's, in use, or it has just gone
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if os.fstat(lock).st_uid == os.getuid():
                    shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(lock)


def _remove(folder: Path, lock: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    os.close(lock)
