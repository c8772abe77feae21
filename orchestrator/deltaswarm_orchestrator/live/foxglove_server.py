"""A live view of a run for Foxglove and Lichtblick: the recorder's channels over a WebSocket on loopback.

The server is foxglove-sdk's and has threads of its own. It drops the oldest messages of a viewer that does not read,
so a viewer never makes the run wait.
"""

import logging
import os
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from mcap_protobuf.schema import build_file_descriptor_set

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.live.rate_limit import RateLimited
from deltaswarm_orchestrator.recording.scene import log_time_ns
from deltaswarm_orchestrator.recording.schemas import TOPICS
from deltaswarm_wire.extras import missing

HOST = "127.0.0.1"

BACKLOG_MESSAGES = 256
"""Messages queued for each viewer; about two seconds' worth."""

STOP_WITHIN_S = 1.0
"""Time that viewers have to read what has been sent, before they are disconnected [s]."""

SERVER_LOG = "foxglove.websocket.server"

REFUSED = (
    "a viewer was refused: it must speak the subprotocol foxglove.sdk.v1 "
    "(Foxglove does; Lichtblick before 1.22 does not)"
)


class LiveError(CommandError):
    """A run cannot be shown live; the text says why, and what to do."""


def check_installed() -> None:
    """Check that the extra `live` is installed.

    Raises:
        LiveError: it is not installed.
    """
    if needs := missing("foxglove"):
        raise LiveError(f"--live foxglove {needs}")


class FoxgloveServer(RateLimited):
    """A `Viewer` on loopback to which any number of Foxglove windows can connect; port 0: any free one."""

    def __init__(self, name: str, port: int, say: Callable[[str], None]) -> None:
        check_installed()
        import foxglove
        import foxglove.websocket as websocket

        super().__init__(self._show)
        self._sent_time_s = -1.0
        """Simulated time last sent to viewers [s]."""
        self._context = context = foxglove.Context()  # kept alive: its channels need it
        self._channels = {topic: _channel(foxglove, context, topic) for topic in TOPICS}
        self._log_handler = _Refusals(say)
        logging.getLogger(SERVER_LOG).addHandler(self._log_handler)
        try:
            self._server = foxglove.start_server(
                name=name,
                host=HOST,
                port=port,
                capabilities=[websocket.Capability.Time],
                server_listener=_listener(websocket.ServerListener, self._welcome),
                context=context,
                message_backlog_size=BACKLOG_MESSAGES,
            )
        except RuntimeError as error:
            self._stop_logging()
            reason = str(error).removeprefix("FoxgloveError: ")
            raise LiveError(f"--live-port {port}: {reason}; choose another port, or 0 for any free one") from None

        self._port: int = self._server.port

    @property
    def url(self) -> str:
        return f"ws://{HOST}:{self._port}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.flush()
        self._stop_logging()
        # The server would wait forever for viewers that do not read what has been sent.
        stopping = threading.Thread(target=self._server.stop, daemon=True)
        stopping.start()
        stopping.join(STOP_WITHIN_S)
        if stopping.is_alive():
            _cut_off(self._port)
            stopping.join(STOP_WITHIN_S)

    def look(self, seen: object) -> None:
        """Send what is due. Called by the run's watch, also while no step is made."""
        self.tick()

    def _welcome(self) -> None:
        self._sent_time_s = -1.0
        self.show_all()

    def _show(self, topic: str, time_s: float, data: bytes) -> None:
        if self.time_s > self._sent_time_s:
            self._sent_time_s = self.time_s
            self._server.broadcast_time(log_time_ns(self.time_s))
        channel = self._channels[topic]
        if channel.has_sinks():
            channel.log(data, log_time=log_time_ns(time_s))

    def _stop_logging(self) -> None:
        logging.getLogger(SERVER_LOG).removeHandler(self._log_handler)


def _channel(foxglove: Any, context: Any, topic: str) -> Any:
    kind = TOPICS[topic]
    data = build_file_descriptor_set(kind).SerializeToString()
    schema = foxglove.Schema(name=kind.DESCRIPTOR.full_name, encoding="protobuf", data=data)
    return foxglove.Channel(topic, schema=schema, message_encoding="protobuf", context=context).base


def _cut_off(port: int) -> None:
    """Shut down all connections to this process's own port: those of viewers that do not read."""
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError), socket.socket(fileno=os.dup(int(name))) as copy:
            if copy.family == socket.AF_INET and copy.getsockname()[1] == port:
                copy.shutdown(socket.SHUT_RDWR)


def _listener(base: Any, subscribed: Callable[[], None]) -> Any:
    class Listener(base):  # type: ignore[misc]
        def on_subscribe(self, client: object, channel: object) -> None:
            """Have the newest message of every topic sent again, however old, for a new subscriber."""
            subscribed()

    return Listener()


class _Refusals(logging.Handler):
    """Reports refused viewers to the user, once instead of a line for each."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__(logging.ERROR)
        self._say = say
        self._has_reported = False

    def emit(self, record: logging.LogRecord) -> None:
        if "handshake failed" in record.getMessage() and not self._has_reported:
            self._has_reported = True
            self._say(REFUSED)
