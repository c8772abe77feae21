"""How a process opens its Zenoh session, as plain (key, JSON value) pairs, and what its endpoints may be.

An endpoint is `PROTOCOL/ADDRESS`, as in `tcp/192.168.1.10:7447`. The world's session is the router; `access.py` has its
access rules.
"""

import ipaddress
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from deltaswarm_wire.access import TLS, revoked_beside, world_rules
from deltaswarm_wire.checked import Problem, one_line
from deltaswarm_wire.codec import MAX_SAMPLE_BYTES
from deltaswarm_wire.keys import OPERATOR, RECORDER, Keys

QUIC = "quic"
WITH_PORT = ("tcp", "udp", TLS, QUIC, "ws")
"""Protocols whose address is HOST:PORT."""
OVER_TCP = ("tcp", TLS, "ws")
WITHOUT_PORT = ("serial", "unixpipe", "unixsock-stream", "vsock")


def protocol_of(endpoint: str) -> str:
    """Return `tcp` for `tcp/127.0.0.1:7447`."""
    return endpoint.partition("/")[0]


def free_port(host: str = "127.0.0.1") -> int:
    """Return a port on which nobody listens now. Raises OSError if the host is not this machine's."""
    import socket  # not for boards

    with socket.create_server((host, 0), family=socket.AF_INET6 if ":" in host else socket.AF_INET) as server:
        return int(server.getsockname()[1])


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Parse host and port: `("::1", 7447)` from `tcp/[::1]:7447#iface=lo`."""
    address = re.split("[?#]", endpoint.partition("/")[2], maxsplit=1)[0]
    match = re.fullmatch(r"(?a:(\[[^\s\[\]]+\]|[^\s:\[\]]+):(\d{1,5}))", address)
    if not match or int(match[2]) > 0xFFFF:
        raise ValueError("must have HOST:PORT after the protocol, as in tcp/10.0.0.3:7447 or tcp/[::1]:7447")
    if re.fullmatch(r"[0-9.]+", match[1]):
        try:
            ipaddress.IPv4Address(match[1])
        except ValueError:
            raise ValueError("must have a valid IPv4 address") from None
    return match[1].strip("[]"), int(match[2])


def endpoint_problem(endpoint: str, *, connects: bool = False) -> str:
    """What an endpoint to listen on (or connect to) must be, or "" if it is well-formed."""
    protocol, _, address = endpoint.partition("/")
    if protocol not in WITH_PORT + WITHOUT_PORT or not address:
        return f"must be PROTOCOL/ADDRESS, as in tcp/10.0.0.3:7447; protocols: {', '.join(WITH_PORT + WITHOUT_PORT)}"
    if protocol in WITHOUT_PORT:
        return ""
    try:
        host, _ = host_and_port(endpoint)
    except ValueError as error:
        return str(error)
    if connects and protocol in (TLS, QUIC) and ":" in host:
        return "must be a name or an IPv4 address over TLS: Zenoh accepts no IPv6 address as a server's name"
    return ""


def link_problems(connect: Sequence[str], listen: Sequence[str], zenoh: Mapping[str, Any]) -> list[Problem]:
    """Check a link's endpoints and its further Zenoh settings."""
    endpoints = [("connect", endpoint) for endpoint in connect] + [("listen", endpoint) for endpoint in listen]
    problems = [
        Problem(name, repr(endpoint), mistake)
        for name, endpoint in endpoints
        if (mistake := endpoint_problem(endpoint, connects=name == "connect"))
    ]
    return problems + [
        Problem(f"zenoh.{name}", repr(value), "must be a string with JSON5")
        for name, value in zenoh.items()
        if type(value) is not str
    ]


CONFIG_VARIABLE = "DELTASWARM_ZENOH_CONFIG"
"""Names a JSON5 file that a session starts from, as in rmw_zenoh."""

PASSWORD_VARIABLE = "DELTASWARM_PASSWORD"
"""Password of a part that is started by hand; unlike an argument, it does not show in process lists."""

_RUNTIME_VARIABLE = "ZENOH_RUNTIME"
_ONE_WORKER = (
    "(rx: (worker_threads: 1), tx: (handover: rx), acc: (handover: rx), net: (handover: rx), app: (handover: rx))"
)

CERTIFIED = "certificate"
"""User name and password of every process with a certificate: the router requires both, but they grant no key."""

MAX_RECEIVED_BYTES = 32 * 1024 * 1024
"""The router disconnects a client that sends a larger sample."""

MAX_AIR_BYTES = 1024 * 1024
"""The same limit for a board in open air, which reassembles a sample in memory before any check."""

Pairs = list[tuple[str, Any]]

NO_SHARED_MEMORY: Pairs = [("transport/shared_memory/enabled", False)]
"""Zenoh's segments in /dev/shm outlive the session, and our samples are too small to benefit from them."""

_RUST_SOURCE = re.compile(r"\s+at \S+\.rs:\d+\.?")

R = TypeVar("R")


@dataclass(frozen=True)
class Tls:
    """PEM files: the trusted authority, the process's own certificate and private key."""

    ca: str
    certificate: str
    key: str


@dataclass(frozen=True)
class RouterLink:
    """How one process reaches the router.

    With `tls` the certificate identifies the process; user and password are unused.
    `low_latency` is for agents on the router's machine: faster, but no sample may exceed 32 KiB.
    `overrides` are the user's own (key, JSON5 text) pairs and take precedence.
    """

    endpoint: str
    user: str = ""
    password: str = ""
    low_latency: bool = False
    overrides: tuple[tuple[str, str], ...] = ()
    tls: Tls | None = None


def use_one_worker_thread() -> None:
    """Make Zenoh use one worker thread unless the user set another number. Call before `import zenoh`.

    With dozens of sessions on few cores, more threads only add context switches.
    """
    os.environ.setdefault(_RUNTIME_VARIABLE, _ONE_WORKER)


C = TypeVar("C")
S = TypeVar("S")


@contextmanager
def closing(session: S, note: Callable[[str], object]) -> Iterator[S]:
    """Close a session at the end. If this fails, as with a peer that is stopped, `note` is told: the work is done."""
    closed: Any = session  # without importing zenoh
    try:
        yield session
    finally:
        try:
            closed.close()
        except Exception as error:
            note(f"the session could not be closed in order: {one_line(without_sources(str(error)))}")


def configured(config: type[C], pairs: Pairs, link: RouterLink) -> C:
    """Build a Zenoh configuration: the user's file (if the environment names one), `pairs`, overrides, in this order.

    It always includes `NO_SHARED_MEMORY`.
    """
    path = os.environ.get(CONFIG_VARIABLE)
    kind: Any = config
    session_config = _accepted(f"{CONFIG_VARIABLE}={path}", kind.from_file, path) if path else kind()
    for key, value in [*NO_SHARED_MEMORY, *pairs]:
        session_config.insert_json5(key, json.dumps(value))
    for key, text in link.overrides:
        _accepted(f"--zenoh {key}={text}", session_config.insert_json5, key, text)
    made: C = session_config
    return made


def _accepted(what: str, call: Callable[..., R], *arguments: str) -> R:
    """Add the setting to Zenoh's errors, which do not name it."""
    try:
        return call(*arguments)
    except Exception as error:
        raise ValueError(f"Zenoh refuses {one_line(what)}: {one_line(without_sources(str(error)))}") from None


def without_sources(text: str) -> str:
    """Remove locations in Zenoh's own sources from an error text; they help no user."""
    return _RUST_SOURCE.sub("", text)


def secret_id(user: str, password: str) -> str:
    """The id of the operator's or recorder's session, by which the world tells its link from others'.

    Zenoh does not say which user a link belongs to. Only a process that knows the password can use this id.
    """
    import hashlib  # not for boards: it brings OpenSSL

    return "1" + hashlib.sha256(f"{user}:{password}".encode()).hexdigest()[:31]  # Zenoh accepts no leading zero


def client_pairs(link: RouterLink) -> Pairs:
    """Settings of a client that connects to a known router and does not scout."""
    pairs: Pairs = [("mode", "client"), ("connect/endpoints", [link.endpoint]), *quiet_pairs(link.low_latency)]
    user, password = (CERTIFIED, CERTIFIED) if link.tls else (link.user, link.password)
    if user:
        pairs += [("transport/auth/usrpwd/user", user), ("transport/auth/usrpwd/password", password)]
    if user in (OPERATOR, RECORDER):
        pairs.append(("id", secret_id(user, password)))
    return pairs + tls_pairs(link.tls, "connect")


def air_pairs(
    mode: str, connect: Sequence[str], listen: Sequence[str], *, multicast: bool = False, gossip: bool = False
) -> Pairs:
    """Settings for open air: no missing endpoint, at the start or later, ends the session."""
    return [
        ("mode", mode),
        ("connect/endpoints", list(connect)),
        ("connect/timeout_ms", -1),
        ("connect/exit_on_failure", False),
        ("connect/retry", {"period_init_ms": 200, "period_max_ms": 2000, "period_increase_factor": 2}),
        ("listen/endpoints", list(listen)),
        ("listen/timeout_ms", -1),
        ("listen/exit_on_failure", False),
        ("scouting/multicast/enabled", multicast),
        ("scouting/gossip/enabled", gossip),
        ("transport/link/rx/max_message_size", MAX_AIR_BYTES),
    ]


def router_pairs(
    link: RouterLink,
    dictionary_file: str,
    keys: Keys,
    agents: Iterable[int],
    listen: Sequence[str] = (),
) -> Pairs:
    """Settings of the router: endpoints to listen on (default: the link's), users from a file, access rules.

    With `link.tls` it accepts TLS clients only with a certificate of its CA. A TLS client is identified by its
    certificate only, any other client by its user name only, so the two cannot be mixed.
    It forwards no report above `MAX_SAMPLE_BYTES`: a large sample is sent in pieces, and its one worker thread would
    wait for room in the outgoing queue without ever emptying it. The world still receives and counts such a report.
    """
    reports = {
        "id": "no-large-reports",
        "flows": ["egress"],
        "messages": ["put"],
        "key_exprs": [keys.all_reports],
        "size_limit": MAX_SAMPLE_BYTES,
    }
    endpoints = list(listen) or [link.endpoint]
    named_over = sorted({protocol_of(endpoint) for endpoint in endpoints} - {TLS}) if link.tls else None
    return [
        ("mode", "router"),
        ("listen/endpoints", endpoints),
        *tls_pairs(link.tls, "listen"),
        *quiet_pairs(low_latency=True),
        ("transport/link/rx/max_message_size", MAX_RECEIVED_BYTES),
        ("transport/auth/usrpwd/dictionary_file", dictionary_file),
        ("access_control", world_rules(keys, agents, named_over, revoked_beside(link.tls.ca) if link.tls else ())),
        ("low_pass_filter", [reports]),
    ]


def tls_pairs(tls: Tls | None, *sides: str) -> Pairs:
    """Settings of the certificates for `connect` or `listen` links, or both; both ends present one (mTLS)."""
    if tls is None:
        return []
    return [
        ("transport/link/tls/root_ca_certificate", tls.ca),
        *((f"transport/link/tls/{side}_certificate", tls.certificate) for side in sides),
        *((f"transport/link/tls/{side}_private_key", tls.key) for side in sides),
        ("transport/link/tls/enable_mtls", True),
        ("transport/link/tls/verify_name_on_connect", True),
        ("transport/link/tls/close_link_on_expiration", True),
    ]


def quiet_pairs(low_latency: bool) -> Pairs:
    """Settings without scouting; with `low_latency`, the faster transport that does not fragment."""
    pairs: Pairs = [("scouting/multicast/enabled", False), ("scouting/gossip/enabled", False)]
    if low_latency:
        pairs += [("transport/unicast/qos/enabled", False), ("transport/unicast/lowlatency", True)]
    return pairs
