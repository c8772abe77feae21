"""The station's process: listens for the browsers of one feed, and serves its page."""

import asyncio
import logging
import socket
from http import HTTPStatus
from pathlib import Path

from websockets.asyncio.server import Server, ServerConnection
from websockets.http11 import Request, Response

from deltaswarm_operator.station import rules
from deltaswarm_operator.station.bundle import bundle
from deltaswarm_operator.station.room import Room
from deltaswarm_operator.station.visitors import CLOSE_WITHIN_S, Visitor, abort_all, host_in_url, listening, response
from deltaswarm_wire.child import say_ready

log = logging.getLogger("deltaswarm.station")

LINGER_S = 5.0
"""Time that the station stays after its feed has closed, for a page that is still loading [s]."""

PAGE = Path(__file__).parent / "page"
MIME_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}


class Station:
    def __init__(self, feed: socket.socket, token: str, *, has_watchers: bool = False) -> None:
        self.room = Room(self._end)
        self._feed = feed
        self._tokens = {rules.OPERATE: token} | ({rules.WATCH: rules.watch_token(token)} if has_watchers else {})
        self._listen = ""
        self._files = page_files()
        self._stop = asyncio.Event()

    async def run(self, host: str, port: int) -> None:
        """Serve until the feed has closed or `stop` is called; say the URL once browsers can connect.

        Raises:
            OSError: the station cannot listen on this address.
        """
        self._listen = host
        async with listening(self.room.converse, host, port, self._answer) as server:
            self.room.follow(self._feed)
            say_ready("\n".join(self._urls(server)))
            await self._stop.wait()
            self.room.hear()  # the feed may have closed just before
            self.room.leave()
            asyncio.get_running_loop().call_later(CLOSE_WITHIN_S, abort_all)

    def stop(self) -> None:
        self._stop.set()

    def _urls(self, server: Server) -> list[str]:
        host, port = next(iter(server.sockets)).getsockname()[:2]
        return [f"http://{host_in_url(host)}:{port}/{token}/" for token in self._tokens.values()]

    def _end(self) -> None:
        self.room.end()
        asyncio.get_running_loop().call_later(LINGER_S, self.stop)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a file, an error, or None for what may become a WebSocket."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not rules.is_our_host(hosts[0], self._listen):
            return response(HTTPStatus.MISDIRECTED_REQUEST)
        role, below = rules.role_and_path(self._tokens, request.path) or (None, None)
        if below == "live":
            if len(origins) != 1 or not rules.is_our_origin(origins[0], hosts[0]):
                return response(HTTPStatus.FORBIDDEN)
            assert isinstance(connection, Visitor)
            connection.role = role or rules.WATCH
            return None if self.room.has_room(connection) else response(HTTPStatus.SERVICE_UNAVAILABLE)
        file = self._files.get(below or "index.html") if below is not None else None
        return response(HTTPStatus.OK, *file) if file else response(HTTPStatus.NOT_FOUND)


def page_files() -> dict[str, tuple[str, bytes]]:
    """Return the page's files with their types by name; all scripts and styles are also there as one."""
    read = {path.relative_to(PAGE).as_posix(): path.read_text("utf-8") for path in sorted(PAGE.rglob("*.*"))}
    served = {name: text for name, text in read.items() if Path(name).suffix in MIME_TYPES} | bundle(read)
    return {name: (MIME_TYPES[Path(name).suffix], text.encode()) for name, text in served.items()}
