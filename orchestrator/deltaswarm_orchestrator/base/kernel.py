"""What the kernel does for a process when its parent dies in any way (Linux)."""

import ctypes
import os
import signal

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


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None, use_errno=True).prctl(option, int(value))
