"""Decides whom the station admits, in which role, and which browser messages it forwards. Pure."""

import base64
import hmac
import ipaddress
from collections.abc import Mapping
from urllib.parse import urlsplit

import orjson

from deltaswarm_scenario.page_messages import MAX_BYTES, MAX_DATAGRAM_BYTES, WATCHER, RefusedError, checked, name_of

OPERATE, WATCH = "operate", "watch"
"""Every role has a token, and so an address, of its own."""

MAX_INTENTS_PER_S = 60
"""Limit for one browser; a person who drags a slider stays far below it."""

HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every answer: nothing from elsewhere, no inline script, no frame, and the token does not leak."""


def is_our_host(host: str | None, listen: str) -> bool:
    """Whether a request's Host header names this station.

    A page from elsewhere can point its own name at this address (DNS rebinding), so a name must be the station's; an
    address cannot be rebound. The port is not checked: it may be that of a tunnel.
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    if name in ("localhost", listen):
        return True
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return False
    return address.is_loopback or not is_loopback(listen)


def is_our_origin(origin: str | None, host: str) -> bool:
    """Whether a page of this station opens the WebSocket: browsers always name the page's origin."""
    return origin == f"http://{host}"


def watch_token(token: str) -> str:
    """Return the token of those who only watch: the same after a restart, and of no help in finding the other one."""
    return base64.urlsafe_b64encode(hmac.digest(token.encode(), WATCH.encode(), "sha256")[:24]).decode()


def role_and_path(tokens: Mapping[str, str], path: str) -> tuple[str, str] | None:
    """Return the role whose token begins a request's path, and what follows `/token/`; None if no token is right.

    `tokens` maps roles to tokens.
    """
    given, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
    for role, token in tokens.items():
        if hmac.compare_digest(given.encode(errors="replace"), token.encode()) and path.startswith(f"/{token}/"):
            return role, rest
    return None


def intent_of(message: str | bytes, browser: int, role: str = OPERATE) -> bytes:
    """Convert a browser's message to a datagram for the feed, with the browser's number.

    Whether its page may send it is for the feed to say, except for one that only watches.
    """
    if not isinstance(message, str):
        raise RefusedError("a message must be text")
    try:
        raw = orjson.loads(message)
    except orjson.JSONDecodeError:
        raise RefusedError("a message must be JSON") from None
    intent = checked(raw, WATCHER if role == WATCH else None)
    datagram = orjson.dumps({**intent, "from": browser})
    if len(datagram) > MAX_DATAGRAM_BYTES:
        raise RefusedError(f"a message must be at most {MAX_BYTES} bytes long", name_of(intent))
    return datagram


def is_loopback(host: str) -> bool:
    """Whether a host is this machine alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
