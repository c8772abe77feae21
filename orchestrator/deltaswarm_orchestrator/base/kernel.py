"""What the kernel does for a process when its parent dies in any way (Linux)."""

import ctypes
import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36


def signal_at_parents_death(number: signal.Signals, parent: int) -> None:
    """Have the kernel send this process a signal when its parent ends, or send it now if the parent has ended."""
    _prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def adopt_orphans(*, do_so: bool) -> None:
    """Adopt all descendants whose parent ends from now on, so that this process learns how they end.

    With `do_so=False` they get the system's first process as their parent again, as is usual.
    """
    _prctl(PR_SET_CHILD_SUBREAPER, do_so)


def end_orphans(session: int) -> None:
    """Kill and reap the processes that this process has adopted from a session, and those that these leave behind."""
    adopted = os.getpid(), session
    while orphans := [pid for pid, *of in _processes() if (*of,) == adopted and pid != session]:
        for pid in orphans:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            with suppress(ChildProcessError):
                os.waitpid(pid, 0)


def _processes() -> Iterator[tuple[int, int, int]]:
    """Yield pid, parent and session of every process."""
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, _, fields = file.read_text(encoding="utf-8", errors="replace").rpartition(")")
        except OSError:
            continue  # it has ended
        _, parent, _, session, *_ = fields.split()
        yield int(file.parent.name), int(parent), int(session)


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None, use_errno=True).prctl(option, int(value))
