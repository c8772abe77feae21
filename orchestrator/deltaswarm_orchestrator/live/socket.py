"""The socket in a run's folder to which `deltaswarm top` connects to watch the run.

Only the folder's owner may connect. Readers are sent the truth; nothing is read from them.
"""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from deltaswarm_orchestrator.live.datagrams import Pictures
from deltaswarm_orchestrator.live.observer import Paced, Seen
from deltaswarm_orchestrator.live.view import hello, picture
from deltaswarm_scenario.scenario import Scenario

LIVE_SOCKET = "live.sock"

MAX_READERS = 16
"""Further readers wait until another one leaves."""


class LiveSocket:
    """An `Onlooker` that shows the run to everyone who connects.

    If the folder cannot hold a socket, the run continues without one.

    Args:
        folder: the run's folder; it may be renamed during the run.
        run: the run's name.
        scenario: the run's scenario.
        paced: says when it is time to look.
    """

    def __init__(self, folder: Path, run: str, scenario: Scenario, paced: Paced | None = None) -> None:
        self._paced = paced or Paced()
        self._greeting = hello(run, scenario)
        self._readers: list[Pictures] = []
        self._file = folder / LIVE_SOCKET
        self._socket: socket.socket | None = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._file.unlink(missing_ok=True)  # left by a killed run
            os.fchmod(self._socket.fileno(), 0o600)  # before it has a name, so that nobody else can connect first
            with short_path(self._file) as name:
                self._socket.bind(name)
            self._socket.listen(MAX_READERS)
            self._socket.setblocking(False)
        except OSError:
            self._socket.close()
            self._socket = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for reader in self._readers:
            reader.close()
        if self._socket is not None:
            self._socket.close()
            with suppress(OSError):
                self._file.unlink()

    def look(self, seen: Seen) -> None:
        """Accept a new reader, send the newest picture to all readers, and drop those that left."""
        if self._socket is None or not self._paced.is_due():
            return
        if len(self._readers) < MAX_READERS:
            with suppress(OSError):
                self._readers.append(Pictures(self._socket.accept()[0], self._greeting))
        if not self._readers or (shown := picture(seen)) is None:
            return
        for reader in self._readers:
            reader.show(shown)
        self._drop_closed()

    def _drop_closed(self) -> None:
        for reader in self._readers:
            if reader.is_closed:
                reader.close()
        self._readers = [reader for reader in self._readers if not reader.is_closed]


@contextmanager
def short_path(file: Path) -> Iterator[str]:
    """Yield a short path of a file, whose full path may be too long for a socket's address."""
    folder = os.open(file.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{file.name}"
    finally:
        os.close(folder)


def connected(folder: Path, within_s: float) -> socket.socket:
    """Connect to the run in progress in a folder, within `within_s` [s].

    Raises:
        OSError: no run is under way there, or this user may not watch it.
    """
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    end.settimeout(within_s)
    try:
        with short_path(folder / LIVE_SOCKET) as name:
            end.connect(name)
    except OSError:
        end.close()
        raise
    return end
