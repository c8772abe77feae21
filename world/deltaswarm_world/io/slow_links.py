"""Cuts the links of clients that do not read: a blocked write stops the world's sending, or the router's one thread.

In lock-step no client leaves more than a few frames unread, so a link whose outgoing buffer is full has a broken or
hostile reader. The links of operator and recorder are never cut: both are trusted, and the world itself waits for them.
"""

import logging
import os
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Container
from contextlib import suppress

from deltaswarm_wire.keys import OPERATOR, RECORDER
from deltaswarm_wire.session import host_and_port, secret_id, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.world")

LOOK_EVERY_S = 0.05
PATIENCE_S = 2.0
"""Total time that slow links may take before they are cut on sight [s]."""
REGAINED = 0.01
"""Time regained in each second without a slow link [s/s]; bounds what a client that keeps coming back costs."""

DESCRIPTORS = "/dev/fd"

NO_LINGER, DISCARD = struct.pack("ii", 0, 0), struct.pack("ii", 1, 0)
"""Values of SO_LINGER. With Zenoh's own 10 s, closing a link that is not read would block the router for 10 s."""

Address = tuple[str, int]


def trusted_sessions(credentials: str) -> set[str]:
    """Return the session ids of operator and recorder, from all `user:password` lines."""
    pairs = (line.partition(":") for line in credentials.splitlines())
    return {secret_id(user, password) for user, _, password in pairs if user in (OPERATOR, RECORDER)}


class SlowLinks:
    """Watches the router's links over TCP, TLS and WebSocket in a separate thread.

    Create it before anybody is told where the router listens. Existing links are not watched, since listing them makes
    Zenoh 1.10.2 panic if one of them is of low latency.

    Args:
        session: the router's session.
        trusted: ids, as text, of sessions whose links are never cut.
        waits_for: returns the client that blocks the world's sending, or "".
    """

    def __init__(self, session: zenoh.Session, trusted: Container[str], waits_for: Callable[[], str]) -> None:
        self._trusted, self._waits_for = trusted, waits_for
        self._links: dict[Address, tuple[str, str]] = {}
        """Session id and certified name by address of the other end."""
        self._watched: dict[int, Address] = {}
        """Addresses by descriptor; a stale descriptor is noticed before anything is cut."""
        self._patience_s = PATIENCE_S
        self._changed, self._closing = threading.Event(), threading.Event()
        self._listener = session.info.declare_link_events_listener(
            zenoh.handlers.Callback(self._on_link, indirect=False)
        )
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching; the session is about to close."""
        self._closing.set()
        self._thread.join()
        self._listener.undeclare()

    def _on_link(self, event: zenoh.LinkEvent) -> None:
        with suppress(ValueError):  # a protocol without port
            address = host_and_port(event.link.dst)
            if event.kind == zenoh.SampleKind.PUT:
                self._links[address] = str(event.link.zid), event.link.auth_identifier or ""
            else:
                self._links.pop(address, None)
            self._changed.set()

    def _watch(self) -> None:
        poll, looked_at = select.poll(), time.monotonic()
        while not self._closing.wait(LOOK_EVERY_S):
            if self._changed.is_set():
                self._changed.clear()
                self._watched = self._find()
                poll = select.poll()
                for descriptor in self._watched:
                    poll.register(descriptor, select.POLLOUT)
            ready = {descriptor for descriptor, _ in poll.poll(0)}
            now = time.monotonic()
            passed_s, looked_at = min(now - looked_at, 2 * LOOK_EVERY_S), now  # the world may have been stopped
            slow = [
                link for descriptor, link in self._watched.items() if descriptor not in ready and self._may_cut(link)
            ]
            if not slow:
                self._patience_s = min(PATIENCE_S, self._patience_s + REGAINED * passed_s)
                continue
            self._patience_s -= passed_s
            if self._patience_s <= 0:
                self._patience_s = 0
                for address in slow:
                    self._cut(address)

    def _may_cut(self, address: Address) -> bool:
        session, name = self._links.get(address, ("", ""))
        return session not in self._trusted and name not in (OPERATOR, RECORDER)

    def _find(self) -> dict[int, Address]:
        """Find the descriptors of the links, and set them not to linger."""
        addresses: dict[int, Address] = {}
        for name in os.listdir(DESCRIPTORS):
            with suppress(OSError), _duplicate(int(name)) as link:
                if (address := _other_end(link)) in self._links:
                    addresses[int(name)] = address
                    link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, NO_LINGER)
        return addresses

    def _cut(self, address: Address) -> None:
        name = self._links.get(address, ("", ""))[1] or self._waits_for() or "a client"
        for descriptor in [one for one, its in self._watched.items() if its == address]:
            with suppress(OSError), _duplicate(descriptor) as link:
                if _other_end(link) == address:
                    link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, DISCARD)
                    link.shutdown(socket.SHUT_RDWR)
                    log.warning("%s does not read what it is sent; its link from %s:%d is cut", name, *address)
            del self._watched[descriptor]
            self._changed.set()


def _duplicate(descriptor: int) -> socket.socket:
    """Duplicate a connection, so that it stays valid when Zenoh closes it. Raises OSError if it is no socket."""
    duplicate = os.dup(descriptor)
    try:
        return socket.socket(fileno=duplicate)
    except OSError:
        os.close(duplicate)
        raise


def _other_end(link: socket.socket) -> Address | None:
    if link.family not in (socket.AF_INET, socket.AF_INET6):
        return None
    host, port = link.getpeername()[:2]
    return host.partition("%")[0], port
