"""The pages of one feed: its newest picture goes to browsers, and people's intents go to it.

A room never waits for a browser or the feed; if one cannot take a message now, it is skipped.
"""

import asyncio
import logging
import socket
from collections.abc import Callable, Iterable
from contextlib import suppress

import orjson
from websockets.asyncio.server import ServerConnection, broadcast
from websockets.exceptions import ConnectionClosed

from deltaswarm_operator.station import rules
from deltaswarm_operator.station.visitors import Visitor
from deltaswarm_scenario.page_messages import Message, RefusedError, made, name_of

log = logging.getLogger("deltaswarm.station")

MAX_BROWSERS = 20
MAX_WATCHERS = 10
"""Watchers among the browsers: they must not keep the participant out."""

SLOW_BYTES = 64 * 1024
"""A browser that has not yet taken this much gets no picture."""

STUCK_BYTES = 1024 * 1024
"""A browser that has not yet taken this much is disconnected; its page reconnects and catches up."""

MAX_DATAGRAM_BYTES = 1024 * 1024
MAX_DATAGRAMS_AT_ONCE = 64

ENDED = orjson.dumps(made("ended")).decode()
WATCHES = orjson.dumps(made("role", role="watch")).decode()
NEWEST_ONLY = (b'{"type":"picture"', b'{"type":"truth"')
"""Beginnings of messages of which each replaces the one before. Only the conductor's station is sent the truth."""


class Room:
    """The pages of one feed, and those that come while there is none.

    Args:
        on_end: called once a feed has closed.
    """

    _buffer = memoryview(bytearray(MAX_DATAGRAM_BYTES))

    def __init__(self, on_end: Callable[[], object]) -> None:
        self.dropped = 0
        """Number of intents that were refused or that the feed could not take."""
        self._on_end = on_end
        self._feed: socket.socket | None = None
        self._browsers: dict[int, Visitor] = {}
        self._newest_browser = 0
        self._hello: str | None = None
        self._about: Message = {}
        """What the newest hello says of the run."""
        self._newest: dict[bytes, str] = {}
        """The newest message with each of these beginnings."""
        self._has_ended = False

    def follow(self, feed: socket.socket) -> None:
        """Take a feed, and tell it of the pages that are there."""
        self._feed = feed
        feed.setblocking(False)
        asyncio.get_running_loop().add_reader(feed.fileno(), self.hear)
        for number, visitor in self._browsers.items():
            self._note_page(visitor, number, "opened")

    def leave(self) -> None:
        """Let go of the feed."""
        if self._feed is not None:
            asyncio.get_running_loop().remove_reader(self._feed.fileno())
            self._feed = None

    def end(self) -> None:
        """Tell all pages that the run has ended."""
        self._has_ended = True
        self.tell(ENDED)

    @property
    def has_person(self) -> bool:
        """Whether a page is there that does not only watch."""
        return any(visitor.role != rules.WATCH for visitor in self._browsers.values())

    @property
    def shown(self) -> Message:
        """The run that the pages show, its duration and time [s], and a call for help; empty: there was none yet."""
        picture = self._newest.get(NEWEST_ONLY[0])
        now = orjson.loads(picture) if picture else {}
        return self._about | {name: now[name] for name in ("time_s", "help") if name in now}

    def hear(self) -> None:
        """Take the feed's waiting datagrams; show only the newest picture."""
        if (feed := self._feed) is None:
            return
        newest: dict[bytes, bytes] = {}
        has_closed = False
        for _ in range(MAX_DATAGRAMS_AT_ONCE):
            try:
                datagram = bytes(self._buffer[: feed.recv_into(self._buffer)])
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
            self.leave()  # after the last picture, which would tell pages that the run goes on
            self._on_end()

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
            if self._has_ended:  # the next run: its pictures are yet to come
                self._newest.clear()
            self._hello, self._has_ended = text, False
            self._about = {name: message.get(name) for name in ("run", "duration_s")}
        elif kind == "ended":
            self._has_ended = True
        self.tell(text, None if to is None else [self._browsers[to]] if to in self._browsers else [])

    def tell(self, text: str, browsers: Iterable[Visitor] | None = None) -> None:
        """Send what must not be skipped, by default to all; disconnect a browser that no longer takes anything."""
        able = []
        for browser in [*self._browsers.values()] if browsers is None else browsers:
            if browser.waiting_bytes < STUCK_BYTES:
                able.append(browser)
            else:
                browser.transport.abort()
        broadcast(able, text)

    def has_room(self, visitor: Visitor) -> bool:
        roles = [browser.role for browser in self._browsers.values()]
        is_full = visitor.role == rules.WATCH and roles.count(rules.WATCH) >= MAX_WATCHERS
        return len(roles) < MAX_BROWSERS and not is_full

    async def converse(self, connection: ServerConnection) -> None:
        assert isinstance(connection, Visitor)
        if not self.has_room(connection):  # several browsers connected at the same time
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
                self.tell(orjson.dumps(answer).decode(), [browser])

    def _to_feed(self, datagram: bytes) -> None:
        try:
            if self._feed is None:
                raise ConnectionError if self._has_ended else BlockingIOError
            self._feed.send(datagram)
        except (BlockingIOError, InterruptedError):
            what = name_of(orjson.loads(datagram))
            raise RefusedError("the operator is busy: try again", what, again=True) from None
        except OSError:
            raise RefusedError("the run has ended", name_of(orjson.loads(datagram))) from None
