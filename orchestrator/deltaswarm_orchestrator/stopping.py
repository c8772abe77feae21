"""Signals that ask for the end, from the first moment on. Imports next to nothing: it is there before all else."""

import os
import signal
import threading
from collections.abc import Container, Iterator
from contextlib import contextmanager
from types import FrameType

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Stop:
    """Notes that somebody asked for the end; a handler of signals."""

    def __init__(self) -> None:
        self.by: str | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Note the first signal; raise KeyboardInterrupt at the second: who asks twice is not made to wait."""
        if self.by is not None:
            raise KeyboardInterrupt
        self.by = signal.Signals(number).name


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

    def end(number: int, frame: FrameType | None) -> None:
        os.write(2, f"deltaswarm: stopped by {signal.Signals(number).name}\n".encode())
        os._exit(1)

    for number in _heeded():
        signal.signal(number, end)


def raise_on_signals(raising: Container[signal.Signals] = (signal.SIGINT,)) -> None:
    """Let some signals raise KeyboardInterrupt, by default Ctrl-C as in any Python program; the others end the process.

    In another thread than the main one, as where a program calls a command, signals are that program's.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number in _heeded():
        signal.signal(number, signal.default_int_handler if number in raising else signal.SIG_DFL)
