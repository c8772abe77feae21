"""Addresses at which a command will listen: whether they are free, before anything runs."""

import socket
from collections.abc import Mapping

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.session import OVER_TCP, host_and_port, protocol_of


def check_ports(endpoints: Mapping[str, str]) -> None:
    """Check that a process can listen at endpoints, by the options that name them; those not over TCP are left out."""
    seen: dict[tuple[str, int], str] = {}
    for option, endpoint in endpoints.items():
        if protocol_of(endpoint) not in OVER_TCP:
            continue
        host, port = host_and_port(endpoint)
        if port and (other := seen.setdefault((host, port), option)) != option:
            raise CommandError(f"{option} must be another address than {other} (got {host}:{port})")
        try:
            socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET).close()
        except OSError as error:
            reason = (error.strerror or str(error)).partition(" (while ")[0]
            must = "must be an address of this machine with a free port"
            raise CommandError(f"{option} {must} (got {host}:{port}: {reason}); choose another") from None
