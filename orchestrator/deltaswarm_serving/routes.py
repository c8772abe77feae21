"""Which page a request asks for, and whether it may: the addresses below the service's own. Pure."""

from dataclasses import dataclass
from typing import NamedTuple
from urllib.parse import SplitResult, parse_qs, urlsplit

from deltaswarm_operator.station import rules

JOIN, PERSON, WATCHER, OVERVIEW = "j", "p", "w", "o"
"""First parts of paths: the open link, a participant's own, that of who watches one, the experimenter's."""

RUN, DOOR, LIVE = "run", "door", "live"

PORTS = {"http": 80, "https": 443}

MAX_OUTSIDE = 200
"""Characters of an id from elsewhere; longer ones are cut."""


class Route(NamedTuple):
    kind: str
    """JOIN, PERSON, WATCHER or OVERVIEW."""
    token: str
    below: tuple[str, ...]
    """What follows the token: nothing, without the last slash; an empty name stands for the page."""
    query: str


@dataclass(frozen=True)
class Site:
    """Where the service is reached.

    Args:
        listen: the host that it listens at.
        public: address by which participants reach it, with its path; empty: as it listens.
        embed: origin whose pages may show it in a frame; empty: none.
        is_tls: whether the service itself speaks TLS.
    """

    listen: str
    public: str = ""
    embed: str = ""
    is_tls: bool = False

    @property
    def prefix(self) -> str:
        """The path of the public address, without a slash at its end."""
        return urlsplit(self.public).path.rstrip("/")

    def is_ours(self, host: str) -> bool:
        """Whether a request's Host header names this service."""
        public = urlsplit(self.public)
        return _is_at(public, f"{public.scheme}://{host}") or rules.is_our_host(host, self.listen)

    def is_our_origin(self, origin: str, host: str) -> bool:
        """Whether one of our own pages opens a WebSocket."""
        public = urlsplit(self.public)
        if _is_at(public, f"{public.scheme}://{host}"):
            return _is_at(public, origin)
        return origin == f"http{'s' if self.is_tls else ''}://{host}"

    @property
    def headers(self) -> dict[str, str]:
        """Headers that differ from those of a station."""
        if not self.embed:
            return {}
        name = "Content-Security-Policy"
        policy = rules.HEADERS[name].replace("frame-ancestors 'none'", f"frame-ancestors {self.embed}")
        return {name: policy}

    def route(self, path: str) -> Route | None:
        """Return what a path asks for; None: nothing of ours. A proxy may have removed the public path, or not."""
        path, _, query = path.partition("?")
        within = path.removeprefix(self.prefix) if path.startswith(f"{self.prefix}/") else path
        return _route(within, query) or _route(path, query)


def _route(path: str, query: str) -> Route | None:
    parts = path.removeprefix("/").split("/")
    if len(parts) < 2 or parts[0] not in (JOIN, PERSON, WATCHER, OVERVIEW):
        return None
    return Route(parts[0], parts[1], tuple(parts[2:]), query)


def _is_at(public: SplitResult, origin: str) -> bool:
    """Whether an origin is that of the public address, however the address was written."""
    try:
        given = urlsplit(origin)
        wanted, found = ((one.scheme, one.hostname, one.port or PORTS.get(one.scheme)) for one in (public, given))
    except ValueError:  # no address at all
        return False
    is_plain = given.username is None and origin == f"{given.scheme}://{given.netloc}"
    return bool(public.hostname) and is_plain and found == wanted


def outside_id(query: str, name: str) -> str:
    """Return the id from elsewhere in a query; empty: there is none."""
    return (parse_qs(query).get(name) or [""])[0].strip()[:MAX_OUTSIDE] if name else ""
