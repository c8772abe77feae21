"""The station's sockets: forwards the feed's newest picture to browsers, and people's intents to the feed.

The station never waits for a browser or the feed; if one cannot take a message now, it is skipped.
"""

import asyncio
import logging
import re
import socket
from collections.abc import Iterable
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path
from typing import ClassVar

import orjson
from websockets.asyncio.server import Server, ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.extensions.permessage_deflate import ServerPerMessageDeflateFactory
from websockets.http11 import Request, Response
from websockets.protocol import State

from deltaswarm_operator.station import rules
from deltaswarm_operator.station.bundle import bundle
from deltaswarm_scenario.page_messages import MAX_BYTES, RefusedError, made, name_of
from deltaswarm_wire.child import say_ready

log = logging.getLogger("deltaswarm.station")

MAX_BROWSERS = 20
MAX_WATCHERS = 10
"""Watchers among the browsers: they must not keep the participant out."""
MAX_CONNECTIONS = 80
"""Includes connections that fetch files: a browser opens six at once."""

SLOW_BYTES = 64 * 1024
"""A browser that has not yet taken this much gets no picture."""

STUCK_BYTES = 1024 * 1024
"""A browser that has not yet taken this much is disconnected; its page reconnects and catches up."""

SEND_BUFFER_BYTES = 128 * 1024
"""A connection's buffer in the kernel: small, so that a browser that stops and resumes shows no long backlog."""

MAX_DATAGRAM_BYTES = 1024 * 1024
MAX_DATAGRAMS_AT_ONCE = 64
OPEN_WITHIN_S = 20.0
"""Time that a connection has to ask for something [s]."""

CLOSE_WITHIN_S = 1.0
"""Time that a browser has to take what it was sent, once the station stops [s]."""

LINGER_S = 5.0
"""Time that the station stays after its feed has closed, for a page that is still loading [s]."""

ENDED = orjson.dumps(made("ended")).decode()
WATCHES = orjson.dumps(made("role", role="watch")).decode()
NEWEST_ONLY = (b'{"type":"picture"', b'{"type":"truth"')
"""Beginnings of messages of which each replaces the one before. Only the conductor's station is sent the truth."""

METHOD = re.compile(rb"([A-Z]+) ")
"""How a request begins."""

PAGE = Path(__file__).parent / "page"
MIME_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}

COMPRESSION = [ServerPerMessageDeflateFactory(server_max_window_bits=15, compress_settings={"level": 1, "memLevel": 8})]
"""The window reaches back to the previous picture, from which the next differs little."""


class Visitor(ServerConnection):
    all: ClassVar[dict["Visitor", None]] = {}
    """All connections of the process, which has one station, oldest first."""
    role = rules.OPERATE
    has_begun: bool | None = None
    """Whether it asked by a method that is answered; None: it has sent nothing yet."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Admit the connection; if there are too many, drop the oldest that has not asked for anything."""
        super().connection_made(transport)
        self.all[self] = None
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        if len(self.all) > MAX_CONNECTIONS:
            idle = next(other for other in self.all if other is self or other.protocol.state is State.CONNECTING)
            idle.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Refuse all methods but GET, which the library takes for one or does not answer."""
        if self.has_begun is None:
            method = METHOD.match(data)
            self.has_begun = method is None or method[1] == b"GET"
            if not self.has_begun:
                self.transport.write(_response(HTTPStatus.METHOD_NOT_ALLOWED, Allow="GET").serialize())
                self.transport.write_eof()  # and what still comes is read: a reset could overtake the answer
        if self.has_begun:
            super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.all.pop(self, None)

    @property
    def waiting_bytes(self) -> int:
        return int(self.transport.get_write_buffer_size())


class Station:
    def __init__(self, feed: socket.socket, token: str, *, has_watchers: bool = False) -> None:
        self.dropped = 0
        """Number of intents that were refused or that the feed could not take."""
        self._feed = feed
        self._tokens = {rules.OPERATE: token} | ({rules.WATCH: rules.watch_token(token)} if has_watchers else {})
        self._listen = ""
        self._files = page_files()
        self._browsers: dict[int, Visitor] = {}
        self._newest_browser = 0
        self._hello: str | None = None
        self._newest: dict[bytes, str] = {}
        """The newest message with each of these beginnings."""
        self._has_ended = False
        self._stop = asyncio.Event()
        self._buffer = memoryview(bytearray(MAX_DATAGRAM_BYTES))

    async def run(self, host: str, port: int) -> None:
        """Serve until the feed has closed or `stop` is called; say the URL once browsers can connect.

        Raises:
            OSError: the station cannot listen on this address.
        """
        self._listen = host
        self._feed.setblocking(False)
        loop = asyncio.get_running_loop()
        async with serve(
            self._converse,
            host,
            port,
            create_connection=Visitor,
            process_request=self._answer,
            extensions=COMPRESSION,
            compression=None,
            max_size=MAX_BYTES,
            open_timeout=OPEN_WITHIN_S,
            close_timeout=CLOSE_WITHIN_S,
            server_header=None,
            logger=_quiet_logger(),
        ) as server:
            loop.add_reader(self._feed.fileno(), self._hear_feed)
            say_ready("\n".join(self._urls(server)))
            await self._stop.wait()
            if not self._has_ended:
                loop.remove_reader(self._feed.fileno())
                self._hear_feed()  # which may have closed just before
            # The library waits longer for a browser that takes nothing.
            loop.call_later(CLOSE_WITHIN_S, self._abort_all)

    def stop(self) -> None:
        self._stop.set()

    @staticmethod
    def _abort_all() -> None:
        for visitor in [*Visitor.all]:
            visitor.transport.abort()

    def _urls(self, server: Server) -> list[str]:
        host, port = next(iter(server.sockets)).getsockname()[:2]
        return [f"http://{f'[{host}]' if ':' in host else host}:{port}/{token}/" for token in self._tokens.values()]

    def _hear_feed(self) -> None:
        """Take the waiting datagrams; show only the newest picture."""
        newest: dict[bytes, bytes] = {}
        has_closed = False
        for _ in range(MAX_DATAGRAMS_AT_ONCE):
            try:
                datagram = bytes(self._buffer[: self._feed.recv_into(self._buffer)])
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                datagram = b""
            has_closed = not datagram
            if has_closed:
                break
            begin = next(filter(datagram.startswith, NEWEST_ONLY), None)
            if begin is None:
                self._pass_on(datagram)
            else:
                newest[begin] = datagram
        for begin, shown in newest.items():
            self._newest[begin] = text = shown.decode(errors="replace")
            broadcast([browser for browser in self._browsers.values() if browser.waiting_bytes < SLOW_BYTES], text)
        if has_closed:
            self._end()  # after the last picture, which would tell pages that the run goes on

    def _pass_on(self, datagram: bytes) -> None:
        """Forward a message other than a picture to the browser that it names, else to all."""
        try:
            message = orjson.loads(datagram)
            kind, to = message["type"], message.get("to")
        except (orjson.JSONDecodeError, TypeError, KeyError, AttributeError):
            log.warning("the feed sent an invalid message: %r", datagram[:80])
            return
        text = datagram.decode()
        if kind == "hello":
            self._hello = text
        self._tell(
            self._browsers.values() if to is None else [self._browsers[to]] if to in self._browsers else [], text
        )

    def _tell(self, browsers: Iterable[Visitor], text: str) -> None:
        """Send what must not be skipped; disconnect a browser that no longer takes anything."""
        able = []
        for browser in browsers:
            if browser.waiting_bytes < STUCK_BYTES:
                able.append(browser)
            else:
                browser.transport.abort()
        broadcast(able, text)

    def _end(self) -> None:
        loop = asyncio.get_running_loop()
        loop.remove_reader(self._feed.fileno())
        self._has_ended = True
        self._tell(self._browsers.values(), ENDED)
        loop.call_later(LINGER_S, self.stop)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a file, an error, or None for what may become a WebSocket."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not rules.is_our_host(hosts[0], self._listen):
            return _response(HTTPStatus.MISDIRECTED_REQUEST)
        role, below = rules.role_and_path(self._tokens, request.path) or (None, None)
        if below == "live":
            if len(origins) != 1 or not rules.is_our_origin(origins[0], hosts[0]):
                return _response(HTTPStatus.FORBIDDEN)
            assert isinstance(connection, Visitor)
            connection.role = role or rules.WATCH
            return None if self._has_room(connection) else _response(HTTPStatus.SERVICE_UNAVAILABLE)
        file = self._files.get(below or "index.html") if below is not None else None
        return _response(HTTPStatus.OK, *file) if file else _response(HTTPStatus.NOT_FOUND)

    def _has_room(self, visitor: Visitor) -> bool:
        roles = [browser.role for browser in self._browsers.values()]
        is_full = visitor.role == rules.WATCH and roles.count(rules.WATCH) >= MAX_WATCHERS
        return len(roles) < MAX_BROWSERS and not is_full

    async def _converse(self, connection: ServerConnection) -> None:
        assert isinstance(connection, Visitor)
        if not self._has_room(connection):  # several browsers connected at the same time
            await connection.close(1013, "too many browsers")
            return
        self._newest_browser += 1
        number = self._newest_browser
        for text in (
            WATCHES if connection.role == rules.WATCH else None,
            self._hello,
            *self._newest.values(),
            ENDED if self._has_ended else None,
        ):
            if text is not None:
                broadcast([connection], text)
        self._browsers[number] = connection
        self._note_page(connection, number, "opened")
        try:
            await self._listen_to(connection, number)
        except ConnectionClosed:
            pass  # also if it sent too much at once
        finally:
            del self._browsers[number]
            self._note_page(connection, number, "closed")

    def _note_page(self, visitor: Visitor, number: int, event: str) -> None:
        """Tell the feed that a page of the participant came or went, if it can take that now."""
        if visitor.role == rules.WATCH:
            return
        with suppress(RefusedError):
            self._to_feed(orjson.dumps({"type": "page", "event": event, "from": number}))

    async def _listen_to(self, browser: Visitor, number: int) -> None:
        loop = asyncio.get_running_loop()
        since_s, count = loop.time(), 0
        async for message in browser:
            count += 1
            if loop.time() - since_s >= 1.0:
                since_s, count = loop.time(), 1
            if count > rules.MAX_INTENTS_PER_S:
                await browser.close(1008, "too many messages")
                return
            try:
                self._to_feed(rules.intent_of(message, number, browser.role))
            except RefusedError as refusal:
                self.dropped += 1
                again = {"again": True} if refusal.again else {}
                answer = made("refused", to=number, id=refusal.what, why=str(refusal), **again)
                self._tell([browser], orjson.dumps(answer).decode())

    def _to_feed(self, datagram: bytes) -> None:
        try:
            self._feed.send(datagram)
        except (BlockingIOError, InterruptedError):
            what = name_of(orjson.loads(datagram))
            raise RefusedError("the operator is busy: try again", what, again=True) from None
        except OSError:
            raise RefusedError("the run has ended", name_of(orjson.loads(datagram))) from None


def page_files() -> dict[str, tuple[str, bytes]]:
    """Return the page's files with their types by name; all scripts and styles are also there as one."""
    read = {path.relative_to(PAGE).as_posix(): path.read_text("utf-8") for path in sorted(PAGE.rglob("*.*"))}
    served = {name: text for name, text in read.items() if Path(name).suffix in MIME_TYPES} | bundle(read)
    return {name: (MIME_TYPES[Path(name).suffix], text.encode()) for name, text in served.items()}


def _response(
    status: HTTPStatus, mime_type: str = "text/plain; charset=utf-8", body: bytes | None = None, **more: str
) -> Response:
    body = f"{status.phrase}\n".encode() if body is None else body
    headers = {
        **rules.HEADERS,
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
