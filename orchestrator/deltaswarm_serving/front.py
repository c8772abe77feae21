"""The sockets of a study by link: one address for the doors and pages of all participants and the experimenter."""

import asyncio
import logging
import os
import ssl
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

import orjson
from websockets.asyncio.server import ServerConnection, broadcast
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from deltaswarm_operator.station import rules
from deltaswarm_operator.station.room import Room
from deltaswarm_operator.station.server import page_files
from deltaswarm_operator.station.visitors import CLOSE_WITHIN_S, Visitor, abort_all, host_in_url, listening, response
from deltaswarm_serving.hosting import MOVED
from deltaswarm_serving.line import Limiter
from deltaswarm_serving.routes import DOOR, JOIN, LIVE, OVERVIEW, PERSON, RUN, WATCHER, Route, Site, outside_id
from deltaswarm_serving.study import EARLY, LATE, Study
from deltaswarm_sessions.links import FAILED, RUNNING, Link

log = logging.getLogger("deltaswarm.serve")

TEXT = "text/plain; charset=utf-8"
TICK_S = 0.5
END_WITHIN_S = 20.0
"""What sessions have to end a run in, when the service stops."""
MAX_CONNECTIONS = 4000
STRANGERS_PER_MINUTE = 60
"""Requests from one address with tokens that nobody has."""

MAX_DOOR_MESSAGES = 100
"""What one page at a door may send."""


def address_of(listen: str, tls: object) -> str:
    """Return the address of a service that listens at HOST:PORT."""
    host, _, port = listen.rpartition(":")
    return f"http{'s' if tls else ''}://{host_in_url(host.strip('[]'))}:{port}"


@dataclass(eq=False)
class Front:
    study: Study
    site: Site
    texts: dict[str, Any]
    """What every door shows: the study's title, what one agrees to, the language."""
    files: dict[str, tuple[str, bytes]] = field(default_factory=page_files)
    _doors: dict[str, list[Visitor]] = field(default_factory=dict)
    """The pages at doors, by the token of the link."""
    _told: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What they were told last."""
    _strangers: Limiter = field(default_factory=lambda: Limiter(STRANGERS_PER_MINUTE, 60.0))
    _stop: asyncio.Event = field(default_factory=asyncio.Event)

    async def run(
        self,
        host: str,
        port: int,
        tls: ssl.SSLContext | None = None,
        ready: Callable[[int], object] = lambda port: None,
    ) -> None:
        """Serve until `stop` is called. Sessions under way then end at once, and go on with the next service.

        `ready` is called with the port once browsers can connect.

        Raises:
            OSError: the service cannot listen on this address.
        """
        Visitor.most = MAX_CONNECTIONS
        async with listening(self._converse, host, port, self._answer, ssl=tls) as server:
            ready(next(iter(server.sockets)).getsockname()[1])
            ticking = asyncio.get_running_loop().create_task(self._tick())
            await self._stop.wait()
            ticking.cancel()
            for hosted in self.study.hosted.values():
                hosted.let_go()
            asyncio.get_running_loop().call_later(CLOSE_WITHIN_S, abort_all)
        with suppress(TimeoutError):
            async with asyncio.timeout(END_WITHIN_S):
                await asyncio.gather(*(hosted.gone() for hosted in self.study.hosted.values()))
        self.study.save()

    def stop(self) -> None:
        self._stop.set()

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            try:
                await self.study.admit(self._doors.keys() | self._inside)
                for token in [*self._doors]:
                    self._tell(token)
            except Exception:
                log.exception("the service goes on after an error")

    @property
    def _inside(self) -> set[str]:
        return {token for token, hosted in self.study.hosted.items() if hosted.pages.has_person}

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a file, an error, or None for what may become a WebSocket."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        assert isinstance(connection, Visitor)
        if len(hosts) != 1 or not self.site.is_ours(hosts[0]):
            return self._respond(HTTPStatus.MISDIRECTED_REQUEST)
        route = self.site.route(request.path)
        if route is None or not self._is_known(route):
            is_few = self._strangers.allows(self._address(connection, request), asyncio.get_running_loop().time())
            return self._respond(HTTPStatus.NOT_FOUND if is_few else HTTPStatus.TOO_MANY_REQUESTS)
        if not route.below:
            query = f"?{route.query}" if route.query else ""
            return self._respond(HTTPStatus.PERMANENT_REDIRECT, Location=f"{route.token}/{query}")
        if route.below[-1] in (LIVE, DOOR):
            if len(origins) != 1 or not self.site.is_our_origin(origins[0], hosts[0]):
                return self._respond(HTTPStatus.FORBIDDEN)
            connection.asked = (route, self._address(connection, request))
            return None
        return self._file(route)

    def _is_known(self, route: Route) -> bool:
        links = self.study.links
        if route.kind == PERSON:
            return links.by_token(route.token) is not None
        if route.kind == WATCHER:
            return links.by_watchers(route.token) is not None
        wanted = links.join if route.kind == JOIN else links.overview
        return rules.role_and_path({rules.OPERATE: wanted}, f"/{route.token}/") is not None

    def _file(self, route: Route) -> Response:
        """Return a file of the page that a route is within."""
        *folders, name = route.below
        page = {OVERVIEW: "overview.html", WATCHER: "index.html"}.get(route.kind, "door.html")
        if folders and (folders[0] == RUN or (route.kind == OVERVIEW and folders[0].isdecimal())):
            page, folders = "index.html", folders[1:]
        file = self.files.get("/".join([*folders, name]) if name else page)
        return self._respond(HTTPStatus.OK, *file) if file else self._respond(HTTPStatus.NOT_FOUND)

    def _respond(self, status: HTTPStatus, mime_type: str = TEXT, body: bytes | None = None, **more: str) -> Response:
        return response(status, mime_type, body, **self.site.headers, **more)

    def _address(self, connection: Visitor, request: Request) -> str:
        """Return the network address of a browser: behind a proxy, the last one that it names."""
        is_behind_proxy = self.site.public and not self.site.is_tls  # else anybody could name any
        forwarded = request.headers.get_all("X-Forwarded-For") if is_behind_proxy else []
        if forwarded:
            return forwarded[-1].rpartition(",")[2].strip()
        return str((connection.remote_address or ("",))[0])

    async def _converse(self, connection: ServerConnection) -> None:
        assert isinstance(connection, Visitor)
        route, address = connection.asked
        try:
            if route.kind == OVERVIEW:
                await self._at_overview(connection, route)
            elif route.kind == JOIN:
                await self._at_open_link(connection, route, address)
            elif route.kind == WATCHER and (link := self.study.links.by_watchers(route.token)):
                connection.role = rules.WATCH
                await self._in_room(connection, self.study.host(link).pages)
            elif link := self.study.links.by_token(route.token):
                await self._at_link(connection, route, link)
        except ConnectionClosed:
            pass

    async def _at_link(self, visitor: Visitor, route: Route, link: Link) -> None:
        if route.below[0] == DOOR:
            await self._at_door(visitor, link)
        elif link.state != RUNNING:
            await visitor.send(MOVED)
        else:
            await self._in_room(visitor, self.study.host(link).pages)

    async def _in_room(self, visitor: Visitor, room: Room) -> None:
        if room.has_room(visitor):
            await room.converse(visitor)

    async def _at_door(self, visitor: Visitor, link: Link) -> None:
        there = self._doors.setdefault(link.token, [])
        there.append(visitor)
        if link.agreed and link.state != FAILED:
            self.study.agree(link)  # comes back
        try:
            self._tell(link.token, visitor)
            async for message in self._messages(visitor):
                if message.get("type") == "agree":
                    self.study.agree(link)
                elif message.get("type") == "decline":
                    self.study.decline(link)
                self._tell(link.token)
        finally:
            there.remove(visitor)
            if not there:
                del self._doors[link.token]
                self._told.pop(link.token, None)

    async def _at_open_link(self, visitor: Visitor, route: Route, address: str) -> None:
        """A person without a link of their own: they get one once they agree, or are known by an id from elsewhere."""
        outside = outside_id(route.query, self.study.settings.outside_id)
        if known := self.study.links.of_outside(outside):
            await visitor.send(self._go(known))
            return
        door = {"state": "new", "has_agreed": False, "place": 0}
        door |= {"closed": self.study.why_closed(), "opens": self.study.settings.opens}
        await visitor.send(orjson.dumps({"type": "door", **door, **self.texts}).decode())
        async for message in self._messages(visitor):
            if message.get("type") != "agree" or self.study.why_closed() in (EARLY, LATE):
                continue
            if (link := self.study.join(outside, address)) is None:
                await visitor.send('{"type":"full"}')
                continue
            self.study.agree(link)
            await visitor.send(self._go(link))

    @staticmethod
    def _go(link: Link) -> str:
        return orjson.dumps({"type": "go", "address": f"../../{PERSON}/{link.token}/"}).decode()

    async def _at_overview(self, visitor: Visitor, route: Route) -> None:
        study, first = self.study, route.below[0]
        if first.isdecimal():
            found = next((link for link in study.links.links if link.number == int(first)), None)
            if found is not None:
                await self._in_room(visitor, study.host(found).desk)
            return
        telling = asyncio.get_running_loop().create_task(self._show(visitor))
        try:
            async for message in self._messages(visitor, most=100_000):
                kind, number = message.get("type"), message.get("number")
                if kind == "admissions":
                    study.admits = bool(message.get("open"))
                elif kind == "end" and isinstance(number, int):
                    study.end(number)
                elif kind == "note" and isinstance(number, int):
                    study.note(number, str(message.get("text", ""))[:2000])
        finally:
            telling.cancel()

    async def _show(self, visitor: Visitor) -> None:
        study, line = self.study, self.study.line
        while True:
            told = {"rows": study.rows(), "places": line.at_once, "inside": len(line.inside)}
            told |= {"waiting": len(line.waiting), "admits": study.admits, "closed": study.why_closed()}
            told |= {"cells": study.cells(), "free_bytes": study.free_bytes}
            told["load"] = os.getloadavg()[0] / (os.cpu_count() or 1)
            await visitor.send(orjson.dumps({"type": "overview", **told}).decode())
            await asyncio.sleep(1.0)

    async def _messages(self, visitor: Visitor, most: int = MAX_DOOR_MESSAGES) -> Any:
        """Yield what a page sends, as far as it is an object in JSON."""
        count = 0
        async for text in visitor:
            count += 1
            if count > most:
                await visitor.close(1008, "too many messages")
                return
            try:
                message = orjson.loads(text)
            except orjson.JSONDecodeError:
                continue
            if isinstance(message, dict):
                yield message

    def _tell(self, token: str, newcomer: Visitor | None = None) -> None:
        """Tell the pages at a door how things stand, if that has changed; a newcomer in any case."""
        if (link := self.study.links.by_token(token)) is None:
            return
        there = self._doors.keys() | self._inside
        told = {"type": "door", **self.study.told(link, there), **self.texts, "embed": self.site.embed}
        visitors = [newcomer] if newcomer else self._doors.get(token, []) if told != self._told.get(token) else []
        self._told[token] = told
        broadcast(visitors, orjson.dumps(told).decode())
