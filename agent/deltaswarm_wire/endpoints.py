"""Zenoh's endpoints: `PROTOCOL/ADDRESS`, as in `tcp/192.168.1.10:7447`."""

import ipaddress
import re

from deltaswarm_wire.access import TLS

QUIC = "quic"
WITH_PORT = ("tcp", "udp", TLS, QUIC, "ws")
"""Protocols whose address is HOST:PORT."""
WITHOUT_PORT = ("serial", "unixpipe", "unixsock-stream", "vsock")


def protocol_of(endpoint: str) -> str:
    """Return `tcp` for `tcp/127.0.0.1:7447`."""
    return endpoint.partition("/")[0]


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Parse host and port: `("::1", 7447)` from `tcp/[::1]:7447#iface=lo`.

    Raises:
        ValueError: host and port are missing, or the IPv4 address is malformed.
    """
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
