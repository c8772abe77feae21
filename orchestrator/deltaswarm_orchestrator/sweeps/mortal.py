"""Run a `deltaswarm` command that ends when the process that started it ends, even by SIGKILL."""

import ctypes
import os
import runpy
import signal
import sys

PR_SET_PDEATHSIG = 1


def die_with_parent(number: signal.Signals, parent: int) -> None:
    """Have the kernel send this process a signal when its parent ends (Linux); send it now if the parent has ended."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, int(number))
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


if __name__ == "__main__":
    die_with_parent(signal.SIGTERM, int(sys.argv[1]))
    sys.argv[1:] = sys.argv[2:]
    runpy.run_module("deltaswarm_orchestrator", run_name="__main__")
