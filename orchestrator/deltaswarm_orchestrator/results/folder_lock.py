"""Lock a folder for one process, on any file system; the lock ends with the process, however that ends."""

import fcntl
import json
import os
import platform
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple

LOCK = ".lock"
"""An empty file that is locked by `flock` while the folder is held, and not removed on release."""

OWNER = ".lock-owner"
"""Used where the file system has no `flock`: names the process that holds the folder, and is removed on release."""

CLAIM = ".lock-owner.new"
"""Created by the process that replaces an owner that has ended."""

LOCK_FILES = frozenset({LOCK, OWNER, CLAIM})


class HeldError(Exception):
    """Another process holds the folder; the text, which may be empty, names it in parentheses."""


class Owner(NamedTuple):
    """A process, identified uniquely among all that ever ran on its machine."""

    host: str
    kernel: str
    """Boot and process namespace: each boot and each container numbers its processes anew."""
    pid: int
    started: str
    """Start time in kernel clock ticks since boot."""

    def is_running(self) -> bool | None:
        """Return whether the process runs; None if that cannot be known on this host."""
        if (self.host, self.kernel) != _here():
            return None
        try:
            state, started = _state_and_start(self.pid)
        except OSError:
            return _is_hidden(self.pid)
        return state not in "ZX" and started == self.started


class FolderLock:
    """Holds a folder from its construction until `release` or the end of this process.

    The lock is an `flock`. On a file system without it, such as Lustre without its mount option, a file names the
    owner, and the lock is void once the owner has ended. Whether an owner on another host has ended cannot be known, so
    its file must be deleted by hand. All hosts that share a folder must agree on whether it has `flock`. The folder may
    be renamed while it is held.

    Raises:
        HeldError: another process holds the folder, or may hold it.
        OSError: the folder does not exist, or this process may not write to it.
    """

    def __init__(self, folder: Path) -> None:
        with ExitStack() as stack:
            self._directory = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            stack.callback(os.close, self._directory)
            lock = os.open(LOCK, os.O_RDWR | os.O_CREAT, 0o644, dir_fd=self._directory)
            stack.callback(os.close, lock)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise HeldError from None
            except OSError:
                self._become_owner(folder)
                stack.callback(self._remove, OWNER)
            self._held = stack.pop_all()

    def is_at(self, path: Path) -> bool:
        """Whether the held folder has this path now."""
        try:
            return os.path.samestat(os.fstat(self._directory), os.stat(path, follow_symlinks=False))
        except OSError:
            return False

    def release(self) -> None:
        """Release the folder, wherever it is now; a second call does nothing."""
        self._held.close()

    def _become_owner(self, folder: Path) -> None:
        while not self._create(OWNER):
            text = _read(folder / OWNER)
            if text is None:
                continue  # its owner has just released it
            if (owner := _parsed(text)) is None or owner.is_running() is not False:
                raise HeldError(_described(owner, folder / OWNER))
            if not self._create(CLAIM):
                raise HeldError(f" (if no other run is starting, delete {folder / CLAIM})")
            if _read(folder / OWNER) == text:  # and it stays so, since the claim keeps others from replacing it
                os.replace(CLAIM, OWNER, src_dir_fd=self._directory, dst_dir_fd=self._directory)
                return
            self._remove(CLAIM)

    def _create(self, name: str) -> bool:
        """Create a file that names this process; return False if the file exists."""
        try:
            file = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644, dir_fd=self._directory)
        except FileExistsError:
            return False
        with open(file, "w", encoding="utf-8") as stream:
            json.dump(Owner(*_here(), os.getpid(), _state_and_start(os.getpid())[1]), stream)
        return True

    def _remove(self, name: str) -> None:
        with suppress(FileNotFoundError):
            os.unlink(name, dir_fd=self._directory)


def is_held(folder: Path) -> bool | None:
    """Return whether a process holds a folder; None where that cannot be known."""
    if (text := _read(folder / OWNER)) is not None:
        owner = _parsed(text)
        return None if owner is None else owner.is_running()
    try:
        lock = os.open(folder / LOCK, os.O_RDONLY)
    except FileNotFoundError:
        return False
    except OSError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False  # no `flock` here, and no owner
    finally:
        os.close(lock)
    return False


def _described(owner: Owner | None, file: Path) -> str:
    if owner is None:
        return f" (its owner cannot be read; if it has ended, delete {file})"
    if owner.is_running():
        return f" (process {owner.pid})"
    return f" (process {owner.pid} on host {owner.host}, unknown here; if it has ended, delete {file})"


def _read(file: Path) -> str | None:
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return None


def _parsed(text: str) -> Owner | None:
    try:
        host, kernel, pid, started = json.loads(text)
        return Owner(str(host), str(kernel), int(pid), str(started))
    except (ValueError, TypeError):
        return None


def _here() -> tuple[str, str]:
    boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    return platform.node(), f"{boot} {os.readlink('/proc/self/ns/pid')}"


def _state_and_start(pid: int) -> tuple[str, str]:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return fields[0], fields[19]


def _is_hidden(pid: int) -> bool:
    """Return whether this is another user's process, on a system that hides those."""
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except (OSError, OverflowError):
        pass
    return False
