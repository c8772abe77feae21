"""Measure the floors of a lock-step swarm's step time: the same exchange without any logic, by sockets and by Zenoh.

A step is one 200-byte sample to each agent process and one back from each.
"""

import multiprocessing
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_orchestrator.processes.fork_server import bare_main_module, place_sockets, safe_path
from deltaswarm_orchestrator.processes.starter import PRELOADED, room_for
from deltaswarm_wire.session import RouterLink, client_pairs, configured, free_port, quiet_pairs, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

PAYLOAD = b"x" * 200
QUEUE_SAMPLES = 64


def sockets_steps_per_s(agents: int, steps: int) -> float:
    """Measure what the kernel allows: a pair of Unix sockets per agent process."""
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(agents)]
    with children(_socket_agent, [(far,) for _, far in pairs]):
        links = [near for near, _ in pairs]
        for _, far in pairs:
            far.close()
        for link in links:
            link.recv(1)  # up and running
        began = time.perf_counter()
        for _ in range(steps):
            for link in links:
                link.send(PAYLOAD)
            for link in links:
                link.recv(4096)
        rate = steps / (time.perf_counter() - began)
        for link in links:
            link.close()
    return rate


def _socket_agent(link: socket.socket) -> None:
    with suppress(OSError):  # the other end is gone
        link.send(b"!")
        while link.recv(4096):
            link.send(PAYLOAD)


def zenoh_steps_per_s(agents: int, steps: int) -> float:
    """Measure what Zenoh allows with the swarm's settings: a router here, a client session per agent process."""
    link = RouterLink(f"tcp/127.0.0.1:{free_port()}", low_latency=True, overrides=tuple(room_for(agents)))
    router = [("mode", "router"), ("listen/endpoints", [link.endpoint]), *quiet_pairs(low_latency=True)]
    with zenoh.open(configured(zenoh.Config, router, link)) as session:
        up = session.declare_subscriber("floor/up/*", zenoh.handlers.FifoChannel(4 * agents))
        downs = [
            session.declare_publisher(f"floor/down/{agent}", congestion_control=zenoh.CongestionControl.BLOCK)
            for agent in range(agents)
        ]
        with children(_zenoh_agent, [(agent, steps, link) for agent in range(agents)]):
            for _ in range(agents):
                up.recv()  # up and running
            began = time.perf_counter()
            for _ in range(steps):
                for down in downs:
                    down.put(PAYLOAD)
                for _ in range(agents):
                    up.recv().payload.to_bytes()
            rate = steps / (time.perf_counter() - began)
            for down in downs:
                down.put(PAYLOAD)  # the agents may end
    return rate


def _zenoh_agent(agent: int, steps: int, link: RouterLink) -> None:
    with zenoh.open(configured(zenoh.Config, client_pairs(link), link)) as session:
        down = session.declare_subscriber(f"floor/down/{agent}", zenoh.handlers.FifoChannel(QUEUE_SAMPLES))
        session.put(f"floor/up/{agent}", PAYLOAD, congestion_control=zenoh.CongestionControl.BLOCK)
        up = session.declare_publisher(f"floor/up/{agent}", congestion_control=zenoh.CongestionControl.BLOCK)
        for _ in range(steps):
            down.recv().payload.to_bytes()
            up.put(PAYLOAD)
        down.recv()


@contextmanager
def children(target: Callable[..., None], arguments: Sequence[tuple[object, ...]]) -> Iterator[None]:
    """Start processes from the same fork server as a run's, and end them with the block, or with this process."""
    place_sockets()
    context = multiprocessing.get_context("forkserver")
    processes = [context.Process(target=_work, args=(target, *entry), daemon=True) for entry in arguments]
    try:
        with starting_processes(), bare_main_module(), safe_path():
            context.set_forkserver_preload([*PRELOADED, __name__])
            for process in processes:
                process.start()
        yield
        for process in processes:
            process.join(5)
    finally:
        for process in processes:
            if process.pid is not None:
                process.kill()
                process.join()


def _work(target: Callable[..., None], *arguments: object) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    target(*arguments)


def _end_with_parent() -> None:
    """End this process when the one that asked the fork server for it ends, even by kill -9."""
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)
