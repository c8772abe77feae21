"""Processes of a measurement; a TCP proxy in one that passes everything on after a delay, as a longer link would.

Each direction takes half of the round-trip time, whatever is sent; the throughput is not limited.
"""

import heapq
import multiprocessing
import os
import select
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection

from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.kernel import signal_at_parents_death
from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_orchestrator.processes.fork_server import bare_main_module, safe_path

CHUNK = 65536

END_WITHIN_S = 5.0
"""Time that a process may take to end after its connection has [s]."""


@contextmanager
def child(target: Callable[..., None], *arguments: object) -> Iterator[Connection]:
    """Run `target(connection, *arguments)` in a fresh process that is killed with the block; yield the other end.

    Raises:
        CommandError: the block met the end of the connection, so the process had ended.
    """
    context = multiprocessing.get_context("spawn")  # the caller has threads
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(os.getpid(), target, theirs, *arguments), daemon=True)
    try:
        with starting_processes(), bare_main_module(), safe_path():
            process.start()
        theirs.close()
        yield ours
    except EOFError:
        process.join(END_WITHIN_S)
        if process.exitcode is None:  # it was another's connection
            raise
        raise CommandError(f"a process of the measurement ended with exit code {process.exitcode}", FAILED) from None
    finally:
        ours.close()
        if process.pid is not None:
            process.kill()
            process.join()


def _work(parent: int, target: Callable[..., None], *arguments: object) -> None:
    signal_at_parents_death(signal.SIGKILL, parent)
    target(*arguments)


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
