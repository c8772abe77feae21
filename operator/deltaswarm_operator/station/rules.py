"""Decides whom the station admits, in which role, and which browser messages it forwards. Pure."""

import base64
import hmac
import ipaddress
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

import orjson

INTENTS = frozenset(
    {"command", "veto", "judge", "pace", "read", "isa", "tlx", "form", "note", "page", "sheet", "catch_up", "seek"}
)

OPERATE, WATCH = "operate", "watch"
ALLOWED: Mapping[str, frozenset[str]] = {OPERATE: INTENTS, WATCH: frozenset({"catch_up"})}
"""The messages that each role may send. Every role has a token, and so an address, of its own."""

MAX_INTENT_BYTES = 16 * 1024

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


class RefusedError(ValueError):
    """A browser's message that is not forwarded."""

    def __init__(self, why: str, command: str | None = None) -> None:
        super().__init__(why)
        self.command = command
        """The browser's own id of the command, or the type of another message: what was refused."""


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
    return address.is_loopback or not _is_loopback(listen)


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

    The feed checks everything again; this check only rejects what is no intent at all, or not one of the role's.

    Raises:
        RefusedError: the message is too long, no JSON object, of no known type, or not allowed for the role.
    """
    if not isinstance(message, str):
        raise RefusedError("a message must be text")
    try:
        intent = orjson.loads(message)
    except orjson.JSONDecodeError:
        raise RefusedError("a message must be JSON") from None
    if not isinstance(intent, dict):
        raise RefusedError("a message must be a JSON object")
    command = id_of(intent)
    if not isinstance(intent.get("type"), str) or intent["type"] not in INTENTS:
        raise RefusedError(f"a message's type must be one of {', '.join(sorted(INTENTS))}", command)
    if intent["type"] not in ALLOWED[role]:
        raise RefusedError("this address only watches", command)
    intent["from"] = browser
    datagram = orjson.dumps(intent)
    if len(datagram) > MAX_INTENT_BYTES + 64:
        raise RefusedError(f"a message must be at most {MAX_INTENT_BYTES} bytes long", command)
    return datagram


def id_of(intent: Mapping[str, Any]) -> str | None:
    """Return what a refusal of an intent names: its own id, or else its type."""
    found = intent.get("id") or intent.get("type")
    return found if isinstance(found, str) else None


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
