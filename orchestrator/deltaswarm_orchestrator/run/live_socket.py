"""The socket in a run's folder through which others look on, come and go: `deltaswarm top`.

Whoever may write to the folder as its owner may connect, and is sent the truth. Nothing is read from them.
"""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from deltaswarm_orchestrator.run.feed import Pictures
from deltaswarm_orchestrator.run.onlookers import Paced, Seen
from deltaswarm_orchestrator.run.picture import hello, picture
from deltaswarm_wire.settings import Scenario

LIVE_SOCKET = "live.sock"

MAX_READERS = 16
"""One more has to wait until another leaves."""


class LiveSocket:
    """An `Onlooker` that shows the run to whoever connects.

    Where the folder cannot hold a socket there is none, and the run goes on.

    Args:
        folder: the run's folder; may be renamed meanwhile.
        run: the run's name.
        scenario: the run's.
        paced: says when it is time to look.
    """

    def __init__(self, folder: Path, run: str, scenario: Scenario, paced: Paced | None = None) -> None:
        self._paced = paced or Paced()
        self._greeting = hello(run, scenario)
        self._readers: list[Pictures] = []
        self._file = folder / LIVE_SOCKET
        self._socket: socket.socket | None = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._file.unlink(missing_ok=True)  # of a run that was killed
            os.fchmod(self._socket.fileno(), 0o600)  # before it has a name: nobody else can be quicker
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
        """Welcome those who came, and show the run to all who are there."""
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
    """A name for a file in a folder whose own name may be longer than a socket's address can be."""
    folder = os.open(file.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{file.name}"
    finally:
        os.close(folder)


def connected(folder: Path, within_s: float) -> socket.socket:
    """A connection to the run in a folder, which has some time [s] to take it.

    Raises:
        OSError: there is none under way, or it may not be looked at.
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
