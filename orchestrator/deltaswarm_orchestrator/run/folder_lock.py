"""A folder that one process at a time writes to, on any file system, however that process ends."""

import fcntl
import json
import os
import platform
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple

LOCK = ".lock"
"""Locked by `flock` for as long as the folder is held. It stays, and is empty."""

OWNER = ".lock-owner"
"""Where the file system has no `flock`: names the process that holds the folder, and is gone when it lets go."""

CLAIM = ".lock-owner.new"
"""Made by the one process that puts its own name in place of an owner's that has ended."""

LOCK_FILES = frozenset({LOCK, OWNER, CLAIM})


class HeldError(Exception):
    """Another process holds the folder; the text, which may be empty, says in brackets which one."""


class Owner(NamedTuple):
    """A process, told apart from every other there was on its machine."""

    host: str
    kernel: str
    """Changes with each boot and each container, which count processes anew."""
    pid: int
    started: str
    """In the kernel's own ticks since the boot."""

    def is_running(self) -> bool | None:
        """Whether the process runs; None if that cannot be known here."""
        if (self.host, self.kernel) != _here():
            return None
        try:
            state, started = _state_and_start(self.pid)
        except OSError:
            return _is_hidden(self.pid)
        return state not in "ZX" and started == self.started


class FolderLock:
    """Holds a folder from its construction until `release` or the end of this process.

    By `flock`. Where there is none, as on Lustre without its mount option, a file names the owner, whose lock is void
    once it has ended; of an owner on another host that cannot be known, so its file must be deleted by hand. All
    hosts that share a folder must agree on whether it has `flock`. The folder may be renamed meanwhile.

    Raises:
        HeldError: another process holds the folder, or may do so.
        OSError: there is no folder that this process may write to.
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
        """Let go of the folder, wherever it is now; again, and nothing happens."""
        self._held.close()

    def _become_owner(self, folder: Path) -> None:
        while not self._create(OWNER):
            found = _read(folder / OWNER)
            if found is None:
                continue  # its owner has just let go
            if (owner := _parsed(found)) is None or owner.is_running() is not False:
                raise HeldError(_told(owner, folder / OWNER))
            if not self._create(CLAIM):
                raise HeldError(f" (if nobody is just beginning, delete {folder / CLAIM})")
            if _read(folder / OWNER) == found:  # and so it stays, since nobody else may replace it now
                os.replace(CLAIM, OWNER, src_dir_fd=self._directory, dst_dir_fd=self._directory)
                return
            self._remove(CLAIM)

    def _create(self, name: str) -> bool:
        """A file that names this process; False if it is there already."""
        try:
            file = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644, dir_fd=self._directory)
        except FileExistsError:
            return False
        with open(file, "w") as stream:
            json.dump(Owner(*_here(), os.getpid(), _state_and_start(os.getpid())[1]), stream)
        return True

    def _remove(self, name: str) -> None:
        with suppress(FileNotFoundError):
            os.unlink(name, dir_fd=self._directory)


def is_held(folder: Path) -> bool | None:
    """Whether somebody holds a folder; None where that cannot be known."""
    found = _read(folder / OWNER)
    if found is not None:
        owner = _parsed(found)
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


def _told(owner: Owner | None, file: Path) -> str:
    if owner is None:
        return f" (its owner cannot be read; if it has ended, delete {file})"
    if owner.is_running():
        return f" (process {owner.pid})"
    return f" (process {owner.pid} on host {owner.host}, unknown here; if it has ended, delete {file})"


def _read(file: Path) -> str | None:
    try:
        return file.read_text(errors="replace")
    except FileNotFoundError:
        return None


def _parsed(text: str) -> Owner | None:
    """None if it is damaged, or not whole yet."""
    try:
        host, kernel, pid, started = json.loads(text)
        return Owner(str(host), str(kernel), int(pid), str(started))
    except (ValueError, TypeError):
        return None


def _here() -> tuple[str, str]:
    """This host, and its count of processes."""
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    return platform.node(), f"{boot} {os.readlink('/proc/self/ns/pid')}"


def _state_and_start(pid: int) -> tuple[str, str]:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return fields[0], fields[19]


def _is_hidden(pid: int) -> bool:
    """Whether there is a process of another user, on a system that hides those."""
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except (OSError, OverflowError):
        pass
    return False
