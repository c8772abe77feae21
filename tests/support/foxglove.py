"""A viewer for tests: what Foxglove does on its WebSocket, with nothing of the server's library."""

import base64
import json
import re
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from deltaswarm_orchestrator.recording.schemas import TOPICS
from tests.support.swarms import PATIENCE_S, RunningSwarm

SUBPROTOCOL = Subprotocol("foxglove.sdk.v1")
MESSAGE = struct.Struct("<BIQ")
MESSAGE_DATA = 1
MAX_BYTES = 1 << 24

CHANNELS = range(1, len(TOPICS) + 1)
"""Their numbers at the server of a process that has no other."""


class Viewer:
    """A viewer that has subscribed to every channel."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.server = self._told()
        self.channels: dict[int, dict[str, Any]] = {}
        advertised = self._told()
        factory = DecoderFactory()
        self._decoders = {}
        for channel in advertised["channels"]:
            self.channels[channel["id"]] = channel
            data = base64.b64decode(channel["schema"] + "==")
            schema = Schema(data=data, encoding=channel["schemaEncoding"], id=channel["id"], name=channel["schemaName"])
            self._decoders[channel["id"]] = factory.decoder_for(channel["encoding"], schema)
        wanted = [{"id": number, "channelId": number} for number in self.channels]
        connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def _told(self) -> dict[str, Any]:
        """The next message that is text: the others are the time."""
        while isinstance(data := self.connection.recv(PATIENCE_S), bytes):
            pass
        return dict(json.loads(data))

    def messages(self) -> Iterator[tuple[str, int, Any]]:
        """Topic, log time [ns] and decoded message, as they come."""
        while True:
            data = self.connection.recv(PATIENCE_S)
            if isinstance(data, bytes) and data[0] == MESSAGE_DATA:
                _, channel, time_ns = MESSAGE.unpack_from(data)
                decode = self._decoders[channel]
                assert decode is not None
                yield self.channels[channel]["topic"], time_ns, decode(data[MESSAGE.size :])


@contextmanager
def viewing(url: str) -> Iterator[Viewer]:
    """A viewer at a server."""
    with connect(url, subprotocols=[SUBPROTOCOL], max_size=MAX_BYTES, close_timeout=0.1) as connection:
        yield Viewer(connection)


def url_of(swarm: RunningSwarm) -> str:
    """What a run prints for viewers."""
    assert swarm.process.stderr is not None
    for line in swarm.process.stderr:
        if found := re.search(r"ws://\S+", line):
            return found[0]
    raise AssertionError("the run ended without a URL")


def stuck_at(url: str) -> socket.socket:
    """A viewer that subscribes to everything and never reads again."""
    host, port = url.removeprefix("ws://").split(":")
    stuck = socket.create_connection((host, int(port)))
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    head = [
        *("GET / HTTP/1.1", f"Host: {host}:{port}", "Upgrade: websocket", "Connection: Upgrade"),
        *("Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13"),
        *(f"Sec-WebSocket-Protocol: {SUBPROTOCOL}", "", ""),
    ]
    stuck.sendall("\r\n".join(head).encode())
    wanted = [{"id": number, "channelId": number} for number in CHANNELS]
    text = json.dumps({"op": "subscribe", "subscriptions": wanted}).encode()
    stuck.recv(4096)  # the answer to the handshake
    # One text frame, masked with zeros, of more than 125 bytes.
    stuck.sendall(b"\x81" + bytes([0x80 | 126]) + len(text).to_bytes(2) + bytes(4) + text)
    return stuck
