"""Handle signals that stop the program, also while it starts processes.

Imports next to nothing, because the handlers are set before all else.
"""

import atexit
import os
import signal
import threading
from collections.abc import Container, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from deltaswarm_orchestrator.base.exits import INTERRUPTED

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class _EndAtOnce:
    """A signal handler for when there is nothing to shut down: it prints one line and exits with code 130.

    Once the exit code is decided, the first signal is too late and only noted. The second one ends the process with
    that code, since the reader of its output may have stopped reading.
    """

    def __init__(self) -> None:
        self.code: int | None = None
        self.late: int | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self.code is None:
            with suppress(OSError):
                os.write(2, f"deltaswarm: stopped by {signal.Signals(number).name}\n".encode())
            os._exit(INTERRUPTED)
        if self.late is not None:
            os._exit(self.code)
        self.late = number


_end_at_once = _EndAtOnce()


class Stop:
    """A signal handler that notes a request to stop."""

    def __init__(self) -> None:
        self.by: str | None = None
        self._is_over = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Note the first signal; raise KeyboardInterrupt at the second, so that the user need not wait.

        It is raised only once: what follows is short and must be completed.
        """
        if self._is_over:
            _end_at_once.late = number
        elif self.by is not None:
            self._is_over = True
            raise KeyboardInterrupt
        else:
            self.by = signal.Signals(number).name

    def conclude(self) -> None:
        """Ignore later signals: the outcome is decided, and a signal neither changes nor interrupts it."""
        self._is_over = True


def _heeded() -> list[signal.Signals]:
    """Return the stop signals, except those that are ignored, such as SIGHUP after `nohup`.

    None outside the main thread: a program that calls a command there handles its own signals.
    """
    if threading.current_thread() is not threading.main_thread():
        return []
    return [number for number in STOP_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]


@contextmanager
def stoppable() -> Iterator[Stop]:
    """Let Ctrl-C, SIGTERM and a closed terminal request an orderly stop; a second signal raises KeyboardInterrupt."""
    stop = Stop()
    before = {number: signal.signal(number, stop) for number in _heeded()}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_at_once_on_signals() -> None:
    """Let stop signals end the process with one line and exit code 130, while there is nothing to shut down.

    Signals that the launcher has blocked are delivered again, and ended children can be waited for again.
    """
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    for number in _heeded():
        signal.signal(number, _end_at_once)
    atexit.register(_ignore_signals)


def _ignore_signals() -> None:
    """Ignore stop signals: Python restores their defaults at exit, and a signal would then change the exit code."""
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def decide(code: int, stop: Stop | None = None) -> None:
    """Fix the process's exit code: the results are on disk, and no signal changes the code any more.

    `stop`: its signal was too late for this work, and takes effect if more work follows.
    """
    _end_at_once.code = code
    by = None if stop is None else signal.Signals.__members__.get(stop.by or "")
    if by is not None:
        _end_at_once.late = by


def heed_signals_again() -> None:
    """Undo `decide`, since more work follows; a signal that came too late for the previous work takes effect now."""
    _end_at_once.code = None
    if _end_at_once.late is not None:
        _end_at_once(_end_at_once.late, None)


def raise_on_signals(raising: Container[signal.Signals] = (signal.SIGINT,)) -> None:
    """Let some signals raise KeyboardInterrupt, by default Ctrl-C as in any Python program; the others end it."""
    for number in _heeded():
        signal.signal(number, signal.default_int_handler if number in raising else signal.SIG_DFL)


@contextmanager
def spared_by_ctrl_c() -> Iterator[None]:
    """Let no SIGINT reach the processes and threads that this thread starts here: this process ends them."""
    from multiprocessing.resource_tracker import ensure_running  # slow to import

    ensure_running()  # it unblocks SIGINT when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def starting_processes() -> Iterator[None]:
    """Hold stop signals back, too: if they ended half-started processes, each of these would print a traceback."""
    with stoppable() as stop:
        try:
            with spared_by_ctrl_c():
                yield
        finally:
            if stop.by is not None:
                raise KeyboardInterrupt
