"""Start processes through a library that does not expect Ctrl-C meanwhile."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.resource_tracker import ensure_running

from deltaswarm_orchestrator.base.signals import stoppable


@contextmanager
def starting_processes() -> Iterator[None]:
    """Hold stop signals back: half-started processes would end with a traceback each.

    A terminal's Ctrl-C never reaches the processes that are started here: it is for this one, which ends them.

    Raises:
        KeyboardInterrupt: at the end if a signal came; at once if two did.
    """
    ensure_running()  # it unblocks SIGINT when it starts
    with stoppable() as stop:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    if stop.by is not None:
        raise KeyboardInterrupt
