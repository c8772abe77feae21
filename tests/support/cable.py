"""A TCP link that a test can cut, hold and mend: a proxy on loopback."""

import contextlib
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

CHUNK = 65536
ALTERED_FROM_BYTES = 200
"""Shorter chunks pass as they are."""


class Cable:
    """Forwards whoever connects to `port` to another port, while it is whole.

    Cut, its connections are closed and new ones too; held, it takes nothing more, and what was sent arrives late.
    Dead, it takes everything and passes nothing on, and closes nothing, as a network that a laptop has left; mended,
    it passes on only what comes over new connections. It may also alter what passes.
    """

    def __init__(self, to_port: int) -> None:
        self._to = ("127.0.0.1", to_port)
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._is_over = False
        self._is_cut = False
        self._is_held = False
        self._is_dead = self._passes_down = False
        self._lost: set[socket.socket] = set()
        """The ends of connections over which nothing passes any more."""
        self.delay_s = 0.0
        """How long each chunk is on the way, in both directions [s]."""
        self._on_the_way: deque[tuple[float, socket.socket, bytes]] = deque()
        self._ended: set[socket.socket] = set()
        """Ends whose last chunk is on the way."""
        self.altered = 0
        """Chunks that were not passed on as they came."""
        self._replaced = (b"", b"")
        self._pairs: dict[socket.socket, socket.socket] = {}
        self._wakeup, self._woken = socket.socketpair()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def cut(self) -> None:
        """Break it."""
        self._is_cut = True
        self._wake()

    def hold(self) -> None:
        """Let nothing through, without closing anything."""
        self._is_held = True
        self._wake()

    def die(self, *, down: bool = True) -> None:
        """Swallow all bytes, without closing anything; or only those that go to the port, without `down`."""
        self._is_dead, self._passes_down = True, not down
        self._lost |= set(self._pairs)
        self._wake()

    def alter(self, old: bytes, new: bytes) -> None:
        """Replace these bytes in what comes to the port; where they do not show, change a byte in what is long enough.

        Nothing for `old`: alter nothing more.
        """
        self._replaced = (old, new)

    def mend(self) -> None:
        """Make it whole."""
        self._is_cut = self._is_held = self._is_dead = False
        self._wake()

    def close(self) -> None:
        """End."""
        self._is_over = True
        self._wake()
        self._thread.join(5)
        self._server.close()
        self._wakeup.close()
        self._woken.close()

    def _wake(self) -> None:
        self._wakeup.send(b"!")

    def _serve(self) -> None:
        while not self._is_over:
            readers = [self._server, self._woken, *([] if self._is_held else {*self._pairs} - self._ended)]
            wait_s = max(0.0, self._on_the_way[0][0] - time.monotonic()) if self._on_the_way else None
            for ready in select.select(readers, [], [], wait_s)[0]:
                if ready is self._woken:
                    self._woken.recv(CHUNK)
                elif ready is self._server:
                    self._accept()
                elif ready in self._pairs:
                    self._forward(ready)
            while self._on_the_way and self._on_the_way[0][0] <= time.monotonic():
                _, end, data = self._on_the_way.popleft()
                self._pass_on(end, data)
            if self._is_cut:
                for end in list(self._pairs):
                    self._drop(end)
        for end in list(self._pairs):
            self._drop(end)

    def _accept(self) -> None:
        near, _ = self._server.accept()
        try:
            far = None if self._is_cut else socket.create_connection(self._to, 5)
        except OSError:
            far = None
        if far is None:
            near.close()
        else:
            self._pairs[near], self._pairs[far] = far, near
            self._lost |= {near, far} if self._is_dead else set()

    def _forward(self, end: socket.socket) -> None:
        try:
            data = end.recv(CHUNK)
        except OSError:
            data = b""
        if self.delay_s and end not in self._ended:
            if not data:
                self._ended.add(end)
            self._on_the_way.append((time.monotonic() + self.delay_s, end, data))
        else:
            self._pass_on(end, data)

    def _pass_on(self, end: socket.socket, data: bytes) -> None:
        if end not in self._pairs:
            return
        try:
            is_up = end.getsockname()[1] == self.port
            if end not in self._lost or (self._passes_down and not is_up):
                self._pairs[end].sendall(self._passed(data) if is_up else data)
        except OSError:
            data = b""
        if not data:
            self._drop(end)

    def _passed(self, data: bytes) -> bytes:
        old, new = self._replaced
        if not old or len(data) < ALTERED_FROM_BYTES:
            return data
        at = len(data) // 2
        passed = data.replace(old, new) if old in data else data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]
        self.altered += passed != data
        return passed

    def _drop(self, end: socket.socket) -> None:
        other = self._pairs.pop(end, None)
        if other is not None:
            self._pairs.pop(other, None)
            self._lost -= {end, other}
            for one in (end, other):
                with contextlib.suppress(OSError):
                    one.close()


@contextmanager
def cable(to_port: int) -> Iterator[Cable]:
    """One that is gone afterwards."""
    made = Cable(to_port)
    try:
        yield made
    finally:
        made.close()
