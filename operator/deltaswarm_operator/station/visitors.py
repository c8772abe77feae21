"""Connections of browsers, the responses they get, and how an address is listened at."""

import asyncio
import logging
import re
import socket
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from http import HTTPStatus
from typing import Any, ClassVar

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.extensions.permessage_deflate import ServerPerMessageDeflateFactory
from websockets.http11 import Request, Response
from websockets.protocol import State

from deltaswarm_operator.station.rules import HEADERS, OPERATE
from deltaswarm_scenario.page_messages import MAX_BYTES

MAX_CONNECTIONS = 80
"""Includes connections that fetch files: a browser opens six at once."""

SEND_BUFFER_BYTES = 128 * 1024
"""A connection's buffer in the kernel: small, so that a browser that stops and resumes shows no long backlog."""

OPEN_WITHIN_S = 20.0
"""Time that a connection has to ask for something [s]."""

CLOSE_WITHIN_S = 1.0
"""Time that a browser has to take what it was sent, once the station stops [s]."""

METHOD = re.compile(rb"([A-Z]+) ")
"""How a request begins."""

COMPRESSION = [ServerPerMessageDeflateFactory(server_max_window_bits=15, compress_settings={"level": 1, "memLevel": 8})]
"""The window reaches back to the previous picture, from which the next differs little."""


class Visitor(ServerConnection):
    all: ClassVar[dict["Visitor", None]] = {}
    """All connections of the process, which listens at one address, oldest first."""
    most: ClassVar[int] = MAX_CONNECTIONS
    """How many there may be."""
    role = OPERATE
    asked: Any = None
    """What its address stands for, as whoever listens has read it."""
    has_begun: bool | None = None
    """Whether it asked by a method that is answered; None: it has sent nothing yet."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Admit the connection; if there are too many, drop the oldest that has not asked for anything."""
        super().connection_made(transport)
        self.all[self] = None
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        if len(self.all) > self.most:
            idle = next(other for other in self.all if other is self or other.protocol.state is State.CONNECTING)
            idle.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Refuse all methods but GET, which the library takes for one or does not answer."""
        if self.has_begun is None:
            method = METHOD.match(data)
            self.has_begun = method is None or method[1] == b"GET"
            if not self.has_begun:
                self.transport.write(response(HTTPStatus.METHOD_NOT_ALLOWED, Allow="GET").serialize())
                if self.transport.can_write_eof():  # and what still comes is read: a reset could overtake the answer
                    self.transport.write_eof()
                else:  # TLS
                    self.transport.close()
        if self.has_begun:
            super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.all.pop(self, None)

    @property
    def waiting_bytes(self) -> int:
        return int(self.transport.get_write_buffer_size())


def listening(
    converse: Callable[[ServerConnection], Awaitable[None]],
    host: str,
    port: int,
    answer: Callable[[ServerConnection, Request], Response | None],
    **more: Any,
) -> AbstractAsyncContextManager[Server]:
    """Return what listens at an address: `answer` responds to a request, or lets it `converse`. `more`: as `serve`."""
    return serve(
        converse,
        host,
        port,
        create_connection=Visitor,
        process_request=answer,
        extensions=COMPRESSION,
        compression=None,
        max_size=MAX_BYTES,
        open_timeout=OPEN_WITHIN_S,
        close_timeout=CLOSE_WITHIN_S,
        server_header=None,
        logger=_quiet_logger(),
        **more,
    )


def host_in_url(host: str) -> str:
    """Return a host as it stands in addresses; for all interfaces, the one by which other machines reach this one."""
    if host not in ("0.0.0.0", "::"):
        return f"[{host}]" if ":" in host else host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # nothing is sent
            found: str = probe.getsockname()[0]
        except OSError:  # no network
            return "127.0.0.1"
    return found


def abort_all() -> None:
    """Disconnect every browser, also one that takes nothing, for which the library waits longer."""
    for visitor in [*Visitor.all]:
        visitor.transport.abort()


def response(
    status: HTTPStatus, mime_type: str = "text/plain; charset=utf-8", body: bytes | None = None, **more: str
) -> Response:
    body = f"{status.phrase}\n".encode() if body is None else body
    headers = {
        **HEADERS,
        **more,
        "Content-Type": mime_type,
        "Content-Length": str(len(body)),
        "Connection": "close",
    }
    return Response(status.value, status.phrase, Headers(headers), body)


def _quiet_logger() -> logging.Logger:
    """Silence the library's logger: a browser that leaves, or a stranger, is not worth a traceback."""
    logger = logging.getLogger("deltaswarm.station.websockets")
    logger.setLevel(logging.CRITICAL)
    return logger
