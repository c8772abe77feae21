"""Wakes the world's process from its wait for samples, and queues what arrives besides them.

Only this file, `transport.py` and `slow_links.py` use Zenoh.
"""

import logging
import signal
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple

from deltaswarm_wire.codec import WireError
from deltaswarm_wire.commands import Pace, Turn, decode_pace, decode_turn
from deltaswarm_wire.keys import AGENT, Keys, parse_token
from deltaswarm_wire.orders import decode_done, decode_taken
from deltaswarm_wire.session import use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.world")

WAKE_EVERY_S = 0.5
"""Longest wait [wall s], so that the world can publish its status."""

STOP_WITHIN_S = 1.0
"""Time that a stopping run waits for agents to close the step."""


class Token(NamedTuple):
    role: str
    number: int
    is_there: bool


class Persisted(NamedTuple):
    """Newest step on disk at operator or recorder (-1: none yet)."""

    role: str
    step: int


class Ack(NamedTuple):
    """The operator's encoded workload."""

    data: bytes


class OperatorMessage(NamedTuple):
    message: Turn | Pace


ControlInput = Token | Persisted | Ack | OperatorMessage


class ControlQueue:
    """A queue from Zenoh's threads to the main one.

    It keeps the newest two tokens of each agent, which may come and go as often as it likes.
    """

    def __init__(self) -> None:
        self._queue: deque[ControlInput | int] = deque()
        """An agent's number stands for its `_tokens`."""
        self._tokens: dict[int, list[bool]] = {}
        self._lock = threading.Lock()

    def put(self, message: ControlInput) -> None:
        """Add to the queue. Never blocks for long."""
        if not isinstance(message, Token) or message.role != AGENT:
            self._queue.append(message)
            return
        with self._lock:
            if message.number not in self._tokens:
                self._queue.append(message.number)
            self._tokens[message.number] = [*self._tokens.get(message.number, [])[-1:], message.is_there]

    def drain(self) -> Iterator[ControlInput]:
        """Yield what has arrived so far; later arrivals wait for the next call."""
        for _ in range(len(self._queue)):
            message = self._queue.popleft()
            if isinstance(message, int):
                with self._lock:
                    tokens = self._tokens.pop(message)
                yield from (Token(AGENT, message, is_there) for is_there in tokens)
            else:
                yield message


class Wakeup:
    """Wakes the main thread from its wait for samples: at a deadline, a token, or a signal.

    Only a sample, which the world sends to itself, reaches a thread blocked in the channel.
    """

    def __init__(self, session: zenoh.Session, keys: Keys) -> None:
        self.deadline = float("inf")
        """Wall time (monotonic) of the next wake-up; set by `wake_at`."""
        self.stopped_by = 0
        """The number of the signal that asks the run to end; 0: none."""
        self.control = ControlQueue()
        self.done: deque[int] = deque()
        self._session = session
        self._key = keys.agent(0, "wake")
        self._nudge = threading.Event()
        on_token = zenoh.handlers.Callback(self._on_token, indirect=False)
        self._subscriber = session.liveliness().declare_subscriber(keys.all_tokens, on_token, history=True)
        put, waking = self.control.put, self._waking
        self._subscribers = [
            session.declare_subscriber(key, zenoh.handlers.Callback(callback, indirect=False))
            for key, callback in (
                (keys.done, waking(lambda key, data: self.done.append(decode_done(data)))),
                (
                    keys.all_taken,
                    waking(lambda key, data: put(Persisted(key.split("/")[-2], decode_taken(data)))),
                ),
                (keys.turn, waking(lambda key, data: put(OperatorMessage(decode_turn(data))))),
                (keys.pace, waking(lambda key, data: put(OperatorMessage(decode_pace(data))))),
                # no wake-up: the operator's next message causes one
                (keys.workload, lambda sample: put(Ack(sample.payload.to_bytes()))),
            )
        ]
        self._closed = False
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()
        self._await_signal()

    @property
    def stop_requested(self) -> bool:
        return self.stopped_by != 0

    def wake_at(self, deadline_s: float) -> None:
        """Wake at a wall time (monotonic) [s], or soon after a signal."""
        self.deadline = deadline_s
        if self.stop_requested:
            self.deadline = min(deadline_s, time.monotonic() + STOP_WITHIN_S)

    def _on_token(self, sample: zenoh.Sample) -> None:
        token = parse_token(str(sample.key_expr))
        if token is not None:
            self.control.put(Token(*token, sample.kind == zenoh.SampleKind.PUT))
            self._nudge.set()

    def _waking(self, take: Callable[[str, bytes], None]) -> Callable[[zenoh.Sample], None]:
        """Make a callback that takes a sample by its key and data, and wakes the main thread."""

        def on_sample(sample: zenoh.Sample) -> None:
            try:
                take(str(sample.key_expr), sample.payload.to_bytes())
            except WireError as error:
                log.warning("dropped a sample on %s: %s", sample.key_expr, error)
            self._nudge.set()

        return on_sample

    def _await_signal(self) -> None:
        """Watch the wake-up descriptor, since a blocked main thread runs no signal handlers."""
        reader, writer = socket.socketpair()
        writer.setblocking(False)
        signal.set_wakeup_fd(writer.fileno())
        self._signals = reader, writer
        threading.Thread(target=self._stop_on, args=(reader,), daemon=True).start()

    def _stop_on(self, reader: socket.socket) -> None:
        (self.stopped_by,) = reader.recv(1)
        self.deadline = min(self.deadline, time.monotonic() + STOP_WITHIN_S)
        self._nudge.set()

    def close(self) -> None:
        self._closed = True
        self._nudge.set()
        self._watcher.join()

    def _watch(self) -> None:
        woken_at = time.monotonic()
        while not self._closed:
            now = time.monotonic()
            left_s = self.deadline - now
            nudged = self._nudge.wait(min(max(left_s, 0.001), 0.1))
            if nudged or left_s <= 0.0 or now - woken_at >= WAKE_EVERY_S:
                woken_at = now
                self._nudge.clear()
                self._session.put(self._key, b"", allowed_destination=zenoh.Locality.SESSION_LOCAL)
