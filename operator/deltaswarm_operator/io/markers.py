"""Markers for other instruments, such as an eye tracker's recorder: what the person does and is asked, as it happens.

Each marker is a JSON object with the time by both clocks. It goes to the clients of a TCP socket, a line each, or into
a marker stream of LSL (the lab streaming layer), with the time of the act as its time stamp.
"""

import json
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from deltaswarm_operator.io.wall_clock import WallClock
from deltaswarm_wire.session import host_and_port

LSL = "lsl"
STREAM, KIND = "deltaswarm", "Markers"
MAX_CLIENTS = 16
SEND_BUFFER_BYTES = 128 * 1024
"""Unread bytes after which a client is dropped, besides those that its own system buffers."""


class SocketMarkers:
    """Sends JSON lines to all clients, and drops a client that does not read."""

    def __init__(self, listen: str, run: str) -> None:
        host, port = host_and_port(f"tcp/{listen}")
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._server = socket.create_server((host, port), family=family)
        self._server.setblocking(False)
        self._clients: list[socket.socket] = []
        self._run = run

    def put(self, monotonic_s: float | None, marker: Mapping[str, Any]) -> None:
        """Send a line to each client, without waiting for any; its time is `monotonic_s`, or now."""
        self.serve()
        for client in [*self._clients]:
            self._send(client, monotonic_s, marker)

    def serve(self) -> None:
        """Accept clients; the first line names the run, and the time by both clocks."""
        with suppress(OSError):
            while len(self._clients) < MAX_CLIENTS:
                client, _ = self._server.accept()
                client.setblocking(False)
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
                self._clients.append(client)
                self._send(client, None, {"kind": "hello", "run": self._run})

    def _send(self, client: socket.socket, monotonic_s: float | None, marker: Mapping[str, Any]) -> None:
        line = f"{_text(monotonic_s, marker)}\n".encode()
        try:
            if client.send(line) == len(line):
                return
        except OSError:
            pass
        self._clients.remove(client)
        client.close()

    def close(self) -> None:
        for stream in (self._server, *self._clients):
            stream.close()


class LslMarkers:
    """One stream of strings, which recorders find again in the next run. Needs the extra `lsl`."""

    def __init__(self) -> None:
        import pylsl

        self._clock: Callable[[], float] = pylsl.local_clock
        info = pylsl.StreamInfo(STREAM, KIND, 1, pylsl.IRREGULAR_RATE, pylsl.cf_string, STREAM)
        self._outlet = pylsl.StreamOutlet(info)

    def put(self, monotonic_s: float | None, marker: Mapping[str, Any]) -> None:
        ago_s = 0.0 if monotonic_s is None else time.monotonic() - monotonic_s
        self._outlet.push_sample([_text(monotonic_s, marker)], self._clock() - ago_s)

    def serve(self) -> None:
        """Do nothing: LSL has threads of its own."""

    def close(self) -> None:
        del self._outlet


Markers = SocketMarkers | LslMarkers


def markers_to(address: str, run: str) -> Markers:
    """Open what `--markers` names: `lsl`, or HOST:PORT. Raises OSError, ImportError."""
    return LslMarkers() if address == LSL else SocketMarkers(address, run)


def _text(monotonic_s: float | None, marker: Mapping[str, Any]) -> str:
    at_s = time.monotonic() if monotonic_s is None else monotonic_s
    told = {name: value for name, value in marker.items() if value not in (None, "")}
    return json.dumps(told | {"utc": WallClock().utc_of(at_s), "monotonic_s": at_s}, separators=(",", ":"))
