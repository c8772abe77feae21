"""Let the kernel end processes when their parent dies, and adopt orphans (Linux)."""

import ctypes
import os
import signal
import sys
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36


def signal_at_parents_death(number: signal.Signals, parent: int) -> None:
    """Have the kernel send this process a signal when its parent ends, or send it now if the parent has ended."""
    _prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def bound_to_this(module: str, *arguments: str) -> list[str]:
    """Return the command line of a Python module that ends with this process, even if that is killed with -9."""
    starter = "deltaswarm_orchestrator.base.dies_with_parent"
    return [sys.executable, "-P", "-m", starter, str(os.getpid()), module, *arguments]


def adopt_orphans(*, do_so: bool) -> None:
    """Adopt all descendants whose parent ends from now on, so that this process learns how they end.

    With `do_so=False` they get the system's first process as their parent again, as is usual.
    """
    _prctl(PR_SET_CHILD_SUBREAPER, do_so)


def end_orphans(session: int, spare: Collection[int] = ()) -> None:
    """Kill and reap the processes that this process has adopted from a session, and those that these leave behind.

    `spare` has those that may go on.
    """
    adopted, spared = (os.getpid(), session), {session, *spare}
    while orphans := [pid for pid, *of in _processes() if (*of,) == adopted and pid not in spared]:
        for pid in orphans:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            with suppress(ChildProcessError):
                os.waitpid(pid, 0)


def is_stopped(pid: int) -> bool:
    """Whether a process is stopped, as by SIGSTOP."""
    try:
        return _fields(Path(f"/proc/{pid}/stat"))[0] == "T"
    except OSError:
        return False


def _processes() -> Iterator[tuple[int, int, int]]:
    """Yield pid, parent and session of every process."""
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, parent, _, session, *_ = _fields(file)
        except OSError:
            continue  # it has ended
        yield int(file.parent.name), int(parent), int(session)


def _fields(file: Path) -> list[str]:
    """Return the fields of a process's `stat` from its state on."""
    return file.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None, use_errno=True).prctl(option, int(value))
