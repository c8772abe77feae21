"""Start processes while a terminal's Ctrl-C may come, which reaches all of its processes at once."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.resource_tracker import ensure_running

from deltaswarm_orchestrator.base.signals import stoppable


@contextmanager
def spared_by_ctrl_c() -> Iterator[None]:
    """Let no SIGINT reach the processes and threads that this thread starts here: this process ends them."""
    ensure_running()  # it unblocks SIGINT when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def starting_processes() -> Iterator[None]:
    """Hold stop signals back, too: if they ended half-started processes, each of these would print a traceback.

    Raises:
        KeyboardInterrupt: at the end if a signal came, whatever else went wrong; at once if two did.
    """
    with stoppable() as stop:
        try:
            with spared_by_ctrl_c():
                yield
        finally:
            if stop.by is not None:
                raise KeyboardInterrupt
