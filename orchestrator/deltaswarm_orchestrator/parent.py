"""A signal at the death of the parent process, however it dies (Linux)."""

import ctypes
import os
import signal

PR_SET_PDEATHSIG = 1


def signal_at_parents_death(number: signal.Signals, parent: int) -> None:
    """Have the kernel send this process a signal when its parent ends, or send it now if the parent has ended."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, int(number))
    if os.getppid() != parent:
        os.kill(os.getpid(), number)
