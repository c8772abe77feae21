"""Signals that ask for the end, from the first moment on. Imports next to nothing: it is there before all else."""

import atexit
import os
import signal
import threading
from collections.abc import Container, Iterator
from contextlib import contextmanager
from types import FrameType

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class _EndAtOnce:
    """A handler of signals for as long as there is nothing to end in order: one line, and exit code 1.

    Once another exit code is decided, the first signal is too late, and the second one ends the process with that code:
    the reader of its output may have stopped reading.
    """

    def __init__(self) -> None:
        self.code: int | None = None
        self.late: int | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self.code is None:
            os.write(2, f"deltaswarm: stopped by {signal.Signals(number).name}\n".encode())
            os._exit(1)
        if self.late is not None:
            os._exit(self.code)
        self.late = number


_end_at_once = _EndAtOnce()


class Stop:
    """Notes that somebody asked for the end; a handler of signals."""

    def __init__(self) -> None:
        self.by: str | None = None
        self._is_over = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Note the first signal; raise KeyboardInterrupt at the second: who asks twice is not made to wait.

        It is raised once: what then follows is short, and must come to its end.
        """
        if self._is_over:
            _end_at_once.late = number
        elif self.by is not None:
            self._is_over = True
            raise KeyboardInterrupt
        else:
            self.by = signal.Signals(number).name

    def conclude(self) -> None:
        """What the end is has been decided: from here on a signal neither changes nor interrupts it."""
        self._is_over = True


def _heeded() -> list[signal.Signals]:
    """Signals that ask for the end, but for those that are ignored, as SIGHUP is after `nohup`."""
    return [number for number in STOP_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]


@contextmanager
def stoppable() -> Iterator[Stop]:
    """Ctrl-C, SIGTERM and a closed terminal ask for an orderly end; a second one is not waited for."""
    stop = Stop()
    before = {number: signal.signal(number, stop) for number in _heeded()}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_at_once_on_signals() -> None:
    """For as long as there is nothing to end in order: one line, and exit code 1."""
    for number in _heeded():
        signal.signal(number, _end_at_once)
    atexit.register(_ignore_signals)


def _ignore_signals() -> None:
    """Python gives signals back their defaults while it ends, and one would then change the exit code."""
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def decide(code: int) -> None:
    """This is the process's exit code: what it stands for is on disk, and no signal changes it."""
    _end_at_once.code = code


def begin_anew() -> None:
    """More is to come, and no exit code is decided: a signal that was too late for what is over is in time for this."""
    _end_at_once.code = None
    if _end_at_once.late is not None:
        _end_at_once(_end_at_once.late, None)


def raise_on_signals(raising: Container[signal.Signals] = (signal.SIGINT,)) -> None:
    """Let some signals raise KeyboardInterrupt, by default Ctrl-C as in any Python program; the others end the process.

    In another thread than the main one, as where a program calls a command, signals are that program's.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number in _heeded():
        signal.signal(number, signal.default_int_handler if number in raising else signal.SIG_DFL)
