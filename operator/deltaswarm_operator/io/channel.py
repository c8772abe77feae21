"""The operator's end of the socket pair to its station. Sending never waits; what does not fit is dropped."""

import json
import socket
import threading
from collections.abc import Callable

from deltaswarm_scenario.page_messages import MAX_DATAGRAM_BYTES, Message

SEND_BUFFER_BYTES = 1024 * 1024


class Channel:
    """Sends datagrams to the station, and receives its intents.

    `take` is called in a separate thread: with each intent, and with None once the station has closed its end.
    """

    def __init__(self, end: socket.socket, take: Callable[[bytes | None], None]) -> None:
        end.setblocking(True)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._end = end
        self._take = take
        threading.Thread(target=self._receive, daemon=True).start()

    def send(self, message: Message) -> None:
        """Send one message; drop it if the station is behind or gone."""
        try:
            self._end.send(json.dumps(message, separators=(",", ":"), allow_nan=False).encode(), socket.MSG_DONTWAIT)
        except OSError:
            return

    def _receive(self) -> None:
        while True:
            try:
                data = self._end.recv(MAX_DATAGRAM_BYTES)
            except OSError:
                data = b""
            self._take(data or None)
            if not data:
                return
