"""A board as a service: its log, its notifications to systemd, and the signals that end it."""

import contextlib
import logging
import logging.handlers
import os
import queue
import signal
import socket
import sys
import threading
from collections.abc import Callable, MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import Self

from deltaswarm_board.settings import LogSettings
from deltaswarm_wire.logs import LogFormatter

log = logging.getLogger("deltaswarm.board")


class _Files(logging.handlers.RotatingFileHandler):
    """Falls back to the previous handlers when the disk is full or read-only."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 (the name that `logging` calls)
        """Handle a line that could not be written; `logging` calls this."""
        error = sys.exc_info()[1]
        root = logging.getLogger()
        if self in root.handlers:  # else another thread has removed it meanwhile
            root.removeHandler(self)
            if self.stream:
                with suppress(OSError):  # else Python would complain of the lines left in its buffer
                    self.stream.close()
            _to_standard_error(logging.NOTSET)
            log.error("logging to %s stopped: %s", self.baseFilename, error)
        if record.levelno < logging.ERROR:  # errors are already on standard error
            root.handle(record)


def log_to(settings: LogSettings, agent: int) -> None:
    """Log to standard error, which systemd keeps; with a folder, to rotating files, and errors to both.

    If the folder is not writable, log this and use standard error.
    """
    root = logging.getLogger()
    root.setLevel(settings.level)
    if not settings.folder:
        return
    folder = Path(settings.folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = _Files(folder / f"agent-{agent}.log", maxBytes=settings.max_bytes, backupCount=settings.backups)
    except OSError as error:
        log.error("cannot log to %s: %s", folder, error)
        return
    _to_standard_error(logging.ERROR)
    files.setFormatter(LogFormatter())
    root.addHandler(files)


def _to_standard_error(level: int) -> None:
    for handler in logging.getLogger().handlers:
        handler.setLevel(level)


class Notifier:
    """A watched service's side of systemd's protocol; without a socket it does nothing."""

    def __init__(self, address: str = "", alive_every_s: float | None = None) -> None:
        self.alive_every_s = alive_every_s
        """Longest interval between calls of `alive` [s]; None: no watchdog."""
        # Linux spells its abstract socket names with a leading NUL, the environment with an @.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if address else None

    @classmethod
    def from_environment(cls, environment: MutableMapping[str, str] = os.environ) -> Self:
        """Read NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID; use half the watchdog's time, as systemd advises."""
        text, pid = environment.get("WATCHDOG_USEC", ""), environment.get("WATCHDOG_PID", "")
        is_watched = text.isdecimal() and int(text) > 0 and pid in ("", str(os.getpid()))
        return cls(environment.get("NOTIFY_SOCKET", ""), int(text) / 2e6 if is_watched else None)

    def ready(self) -> None:
        self._send("READY=1")

    def alive(self) -> None:
        if self.alive_every_s is not None:
            self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        self._send(f"STATUS={text}")

    def stopping(self) -> None:
        self._send("STOPPING=1")

    def close(self) -> None:
        if self._socket:
            self._socket.close()

    def _send(self, text: str) -> None:
        if self._socket:
            with contextlib.suppress(OSError):  # systemd is busy or gone: no reason for an agent to stop
                self._socket.sendto(text.encode(), self._address)


Stop = queue.SimpleQueue[int]
"""Received signals."""

ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)

STAND_WITHIN_S = 3.0
"""What a robot's link has to pass on in that it must stand, before a signal ends the process all the same."""


def stop_on_signals(on_first: Callable[[], None]) -> Stop:
    """Put each ending signal into the queue, unless it is ignored; call `on_first` at the first one.

    Call this in the main thread. Python runs signal handlers only in the main thread, once it returns to Python code:
    too late if it hangs or blocks. Python's C-level handler, however, writes the signal's number to the wake-up
    descriptor at once, in any thread.
    """
    stop: Stop = queue.SimpleQueue()
    reading, writing = socket.socketpair()
    writing.setblocking(False)

    def take() -> None:
        is_first = True
        while writing.fileno() >= 0:  # which also keeps the descriptor open
            for number in reading.recv(64):
                if number not in ENDING:
                    continue  # for a handler that a body has set
                if is_first:
                    on_first()
                is_first = False
                stop.put(number)

    threading.Thread(target=take, name="signals", daemon=True).start()
    signal.set_wakeup_fd(writing.fileno(), warn_on_full_buffer=False)
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)
    return stop


def block_signals() -> None:
    """Keep ending signals from this thread, and from those that it starts: they wait for `stand_on_signals`."""
    signal.pthread_sigmask(signal.SIG_BLOCK, _ending())


def stand_on_signals(stand: Callable[[], None]) -> None:
    """Have a robot stand before a blocked signal ends the process, as it would have ended it.

    The main thread may be blocked in Zenoh, so another one waits for the signal.
    """

    def wait() -> None:
        number = signal.sigwait(_ending())
        standing = threading.Thread(target=stand, daemon=True)
        standing.start()
        standing.join(STAND_WITHIN_S)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
        signal.raise_signal(number)

    threading.Thread(target=wait, name="signals", daemon=True).start()


def _ending() -> set[signal.Signals]:
    return {number for number in ENDING if signal.getsignal(number) is not signal.SIG_IGN}
