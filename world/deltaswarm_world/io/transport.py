"""The world's Zenoh router, publishers and subscriber of agents. `wakeup.py` has the rest of Zenoh."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

from deltaswarm_wire.keys import ACT, FRAME, RADIO, REPORT, TAKEN, WORLD, Keys
from deltaswarm_wire.messages import Frame, encode_frame
from deltaswarm_wire.orders import encode_save
from deltaswarm_wire.session import RouterLink, configured, free_port, router_pairs, use_one_worker_thread
from deltaswarm_world.core.world import untimed

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

RELIEF_EVERY_S = 0.05
BLOCKED_S = 0.2
"""If sending takes this long [s], the receiver is the cause, not a busy machine."""
PORT_TRIES = 20
ANY_PORT = ":0"


Taker = Callable[[int, str, bytes, bytes | None], None]
"""Takes a sample by its agent and the leaf of its key, with the act attached to it."""


class Transport:
    """Publishers, and the queue of agents' samples, over an open router session."""

    def __init__(self, session: zenoh.Session, keys: Keys, agents: int) -> None:
        self.room = 8 * agents + 64
        """Capacity of the queue in samples; a full queue blocks senders."""
        self._channel = session.declare_subscriber(keys.from_agents, zenoh.handlers.FifoChannel(self.room))
        self._handler = self._channel.handler
        self._set_aside: deque[zenoh.Sample] = deque()
        """Samples taken out of the queue while the world was sending."""
        self._lock = threading.Lock()
        self._turns, self._is_receiving, self._is_closed = 0, False, False
        self._is_closing = threading.Event()
        self._relief = threading.Thread(target=self._relieve, daemon=True)
        self._relief.start()
        self._leaf_of = {keys.agent(a, leaf): (a, leaf) for a in range(agents) for leaf in (RADIO, REPORT, ACT, TAKEN)}

        def publisher(key: str, message: str) -> zenoh.Publisher:
            return session.declare_publisher(
                key,
                encoding=zenoh.Encoding(f"application/msgpack;deltaswarm.{message}.v1"),
                congestion_control=zenoh.CongestionControl.BLOCK,
                allowed_destination=zenoh.Locality.REMOTE,
            )

        self._frames = [publisher(keys.agent(agent, FRAME), "Frame") for agent in range(agents)]
        self._sending: tuple[int, float] | None = None
        """The agent whose message is being sent, and since when [wall s]."""
        self.status = publisher(keys.status, "Status").put
        self.order = publisher(keys.orders, "Order").put
        self.clock = publisher(keys.clock, "Clock").put
        self.truth = publisher(keys.truth, "Truth").put
        self.wire = publisher(keys.wire, "Wire").put
        self.forwarded = publisher(keys.forwarded, "Forwarded").put
        self.workload = publisher(keys.counted, "Workload").put
        """Each takes an encoded message."""
        self._token = session.liveliness().declare_token(keys.token(WORLD))
        self.lap: Callable[[str], None] = untimed

    def frames(self, frames: Iterable[tuple[int, Frame]]) -> None:
        for agent, frame in frames:
            self._sending = agent, time.monotonic()
            self._frames[agent].put(encode_frame(frame))
        self._sending = None

    def save(self, agents: Iterable[int], step: int) -> None:
        for agent in agents:
            self._sending = agent, time.monotonic()
            self._frames[agent].put(encode_save(step), attachment=b"save")  # distinguishes it from a frame
        self._sending = None

    def waits_for(self) -> str:
        """Return the agent whose link blocks the world's sending, or ""."""
        agent, since_s = self._sending or (0, float("inf"))
        return f"agent {agent}" if time.monotonic() - since_s > BLOCKED_S else ""

    def receive(self, taker: Taker) -> bool:
        """Wait for a sample, and pass on all that are waiting then; return whether no wake-up was among them."""
        with self._lock:
            self._turns += 1
            self._is_receiving = not self._set_aside
        are_samples = True
        if self._is_receiving:
            sample = self._handler.recv()
            self._is_receiving = False
            self.lap("waiting")
            are_samples = self._hand_over(sample, taker)
        are_samples &= self.receive_waiting(taker)
        self.lap("intake")
        return are_samples

    def receive_waiting(self, taker: Taker) -> bool:
        """Pass on the waiting samples, at most one full queue; return whether no wake-up was among them."""
        are_samples = True
        with self._lock:
            while self._set_aside:
                are_samples &= self._hand_over(self._set_aside.popleft(), taker)
            for _ in range(self.room):
                if (sample := self._handler.try_recv()) is None:
                    break
                are_samples &= self._hand_over(sample, taker)
        return are_samples

    def _hand_over(self, sample: zenoh.Sample, taker: Taker) -> bool:
        source = self._leaf_of.get(str(sample.key_expr))
        if source is None:
            return False
        act = sample.attachment
        taker(*source, sample.payload.to_bytes(), None if act is None else act.to_bytes())
        return True

    def leave(self) -> None:
        """Undeclare the world's token, so that the other parts exit."""
        self._token.undeclare()

    def close(self) -> None:
        """Stop receiving from agents."""
        self._is_closing.set()
        self._channel.undeclare()
        self._is_closed = True
        self._relief.join()
        # A sample may still be on its way into the full queue, and would hold up Zenoh, and the end of the session, for
        # ever: without its receiver the queue takes nothing.
        del self._channel, self._handler

    def _relieve(self) -> None:
        """Empty the queue while the world does not, because sending or ending takes long.

        A full queue, as in a flood, blocks the router's one thread, and with it all sending.
        """
        turns = -1
        while not self._is_closed:
            self._is_closing.wait(RELIEF_EVERY_S)
            with self._lock:  # else a later sample could overtake one set aside
                if self._is_closing.is_set():
                    self._set_aside.clear()
                elif self._is_receiving or turns != self._turns:
                    turns = self._turns
                    continue
                with suppress(zenoh.ZError):  # the channel is closed
                    while (sample := self._handler.try_recv()) is not None:
                        self._set_aside.append(sample)
            if self._is_closing.is_set():
                time.sleep(0.001)


def open_router(
    link: RouterLink,
    credentials: str,
    keys: Keys,
    agents: Sequence[int],
    asked: Sequence[str],
) -> tuple[zenoh.Session, list[str]]:
    """Open the router on these endpoints, where port 0 means any free port; return session and endpoints."""
    zenoh.init_log_from_env_or("off")  # each refused declaration is an error: an agent could fill the disk with them
    may_retry = any(endpoint.endswith(ANY_PORT) for endpoint in asked)
    for attempt in range(PORT_TRIES):
        endpoints = [_with_port(endpoint) for endpoint in asked]
        try:
            session = zenoh.open(
                configured(zenoh.Config, router_pairs(link, credentials, keys, agents, endpoints), link)
            )
        except zenoh.ZError as error:
            if not may_retry or attempt == PORT_TRIES - 1:
                raise ConnectionError(f"the router must be able to listen: {error}") from None
        else:
            return session, endpoints
    raise AssertionError("unreachable")


def _with_port(endpoint: str) -> str:
    return f"{endpoint.removesuffix(ANY_PORT)}:{free_port()}" if endpoint.endswith(ANY_PORT) else endpoint
