"""A TCP proxy in a process of its own that passes everything on after a delay, as a longer link would.

Each direction takes half of the round-trip time, whatever is sent; the throughput is not limited.
"""

import heapq
import select
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection

from deltaswarm_orchestrator.bench.child import child

CHUNK = 65536


@contextmanager
def delaying_proxy(to_port: int, rtt_s: float) -> Iterator[int]:
    """Yield the port of a proxy on loopback to another port there; it adds `rtt_s` to the round-trip time [s]."""
    with socket.create_server(("127.0.0.1", 0)) as server, child(_serve, server, to_port, rtt_s / 2):
        yield server.getsockname()[1]


def _serve(_unused: Connection, server: socket.socket, to_port: int, delay_s: float) -> None:
    """Pass everything on until the process is killed."""
    others: dict[socket.socket, socket.socket] = {}
    held: list[tuple[float, int, socket.socket, bytes]] = []
    count = 0
    while True:
        wait_s = max(0.0, held[0][0] - time.monotonic()) if held else None
        for end in select.select([server, *others], [], [], wait_s)[0]:  # exact to 0.1 ms, as epoll is not
            if end is server:
                others |= _pair(server.accept()[0], to_port)
                continue
            data = b""
            with suppress(OSError):
                data = end.recv(CHUNK)
            count += 1
            heapq.heappush(held, (time.monotonic() + delay_s, count, others[end], data))
            if not data:
                del others[end]
        while held and held[0][0] <= time.monotonic():
            _, _, end, data = heapq.heappop(held)
            with suppress(OSError):
                end.sendall(data) if data else end.shutdown(socket.SHUT_WR)


def _pair(near: socket.socket, to_port: int) -> dict[socket.socket, socket.socket]:
    """Connect an accepted link to the other port; return each end's other end, or nothing if nobody is there."""
    try:
        far = socket.create_connection(("127.0.0.1", to_port))
    except OSError:
        near.close()
        return {}
    for link in (near, far):
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return {near: far, far: near}
