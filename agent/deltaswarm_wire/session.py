"""How a process opens its Zenoh session, as plain (key, JSON value) pairs.

The world's session is the router; who may do what there is in `access.py`.
"""

import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeVar

from deltaswarm_wire.access import TLS, world_rules
from deltaswarm_wire.checked import one_line
from deltaswarm_wire.codec import MAX_SAMPLE_BYTES
from deltaswarm_wire.endpoints import protocol_of
from deltaswarm_wire.keys import Keys

CONFIG_VARIABLE = "DELTASWARM_ZENOH_CONFIG"
"""Names a JSON5 file that a session starts from, as in rmw_zenoh."""

PASSWORD_VARIABLE = "DELTASWARM_PASSWORD"
"""Holds the password of a part that is started by hand, so that it shows in no process list."""

_RUNTIME_VARIABLE = "ZENOH_RUNTIME"
_ONE_WORKER = (
    "(rx: (worker_threads: 1), tx: (handover: rx), acc: (handover: rx), net: (handover: rx), app: (handover: rx))"
)

CERTIFIED = "certificate"
"""User name and password of all who have a certificate: the router wants both from everyone. They alone open no key."""

MAX_RECEIVED_BYTES = 32 * 1024 * 1024
"""The router cuts off whoever sends more in one sample."""

MAX_AIR_BYTES = 1024 * 1024
"""So does a board in open air: a sample is put together in its memory before anybody looks at it."""

Pairs = list[tuple[str, Any]]
R = TypeVar("R")


@dataclass(frozen=True)
class Tls:
    """PEM files: whom to trust, and the process's own certificate and private key."""

    ca: str
    certificate: str
    key: str


@dataclass(frozen=True)
class RouterLink:
    """How one process reaches the router.

    With `tls` the certificate says who it is; user and password are then not used.
    `low_latency` is for agents on the router's machine: faster, but no sample may exceed 32 KiB.
    `overrides` are the user's own (key, JSON5 text) pairs; they win.
    """

    endpoint: str
    user: str = ""
    password: str = ""
    low_latency: bool = False
    overrides: tuple[tuple[str, str], ...] = ()
    tls: Tls | None = None


def use_one_worker_thread() -> None:
    """Let Zenoh run on one worker thread, unless the user says otherwise. Call before `import zenoh`.

    With dozens of sessions on few cores, more threads only add switches.
    """
    os.environ.setdefault(_RUNTIME_VARIABLE, _ONE_WORKER)


class ZenohConfig(Protocol):
    """What is needed of `zenoh.Config`, which this package does not import."""

    @classmethod
    def from_file(cls, path: str) -> Self:
        """A configuration from a JSON5 file."""

    def insert_json5(self, key: str, value: str) -> None:
        """Set one key."""


C = TypeVar("C", bound=ZenohConfig)


def configured(config: type[C], pairs: Pairs, link: RouterLink) -> C:
    """A Zenoh configuration: the user's file, where the environment names one, then ours, then overrides.

    Raises:
        ValueError: the file or an override that Zenoh refuses.
    """
    path = os.environ.get(CONFIG_VARIABLE)
    made = _accepted(f"{CONFIG_VARIABLE}={path}", config.from_file, path) if path else config()
    for key, value in pairs:
        made.insert_json5(key, json.dumps(value))
    for key, text in link.overrides:
        _accepted(f"--zenoh {key}={text}", made.insert_json5, key, text)
    return made


def _accepted(what: str, call: Callable[..., R], *arguments: str) -> R:
    """Zenoh's own errors do not say which setting was meant."""
    try:
        return call(*arguments)
    except Exception as error:
        raise ValueError(f"{one_line(what)}: Zenoh refuses it: {one_line(str(error))}") from None


def client_pairs(link: RouterLink) -> Pairs:
    """A client that knows where its router is, and does not scout."""
    pairs: Pairs = [("mode", "client"), ("connect/endpoints", [link.endpoint]), *quiet_pairs(link.low_latency)]
    user, password = (CERTIFIED, CERTIFIED) if link.tls else (link.user, link.password)
    if user:
        pairs += [("transport/auth/usrpwd/user", user), ("transport/auth/usrpwd/password", password)]
    return pairs + tls_pairs(link.tls, "connect")


def air_pairs(
    mode: str, connect: Sequence[str], listen: Sequence[str], *, multicast: bool = False, gossip: bool = False
) -> Pairs:
    """Open air: nothing that is missing at the start, or later, ends the session."""
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
    *,
    uplink: bool = False,
) -> Pairs:
    """The router: listens on the endpoints (the link's, if none is given), knows users from a file, enforces the rules.

    With `link.tls` it takes no TLS client without a certificate of its CA; who comes over TLS is known by that
    alone, and who comes another way by user name alone, so that neither can be mixed with the other.
    It forwards no report above `MAX_SAMPLE_BYTES`: a large sample goes out in pieces, and its one worker
    thread, waiting for room in the outgoing queue, would never empty it. The world still hears and counts it.
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
        ("access_control", world_rules(keys, agents, named_over, uplink=uplink)),
        ("low_pass_filter", [reports]),
    ]


def tls_pairs(tls: Tls | None, *sides: str) -> Pairs:
    """Certificates for these sides of its links, `connect` and `listen`; both ends show theirs."""
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
    """No scouting; and the faster transport, which does not fragment, where both ends take it."""
    pairs: Pairs = [("scouting/multicast/enabled", False), ("scouting/gossip/enabled", False)]
    if low_latency:
        pairs += [("transport/unicast/qos/enabled", False), ("transport/unicast/lowlatency", True)]
    return pairs
