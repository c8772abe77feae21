"""Arrivals that wait for the operator's main thread; bounded in open air, where untrusted senders may send anything."""

import logging
import queue
import threading
from collections import Counter
from enum import Enum
from typing import Any

from deltaswarm_scenario.person_tables import CONDUCTOR, PERSON
from deltaswarm_wire.codec import MAX_SAMPLE_BYTES
from deltaswarm_wire.keys import parse_agent_key

log = logging.getLogger("deltaswarm.operator")


class ArrivalKind(Enum):
    REPORT = "report"
    CLOCK = "clock"
    LISTENER = "listener"
    HEALTH = "health"
    TOKEN = "token"
    INTENT = "intent"
    CONDUCT = "conduct"
    STOP = "stop"


BY = {ArrivalKind.INTENT: PERSON, ArrivalKind.CONDUCT: CONDUCTOR}
"""Whose intents these are."""


SAMPLE_BYTES = 4096
"""Upper bound of a sample's memory beyond its payload."""

MAX_WAITING_BYTES, MAX_WAITING_BYTES_OF_ONE = 40 * 1024 * 1024, 4 * 1024 * 1024
"""Limits on waiting samples, in total and of one sender: about 10,000 and 1000 small samples.

They bound the memory that untrusted senders can use and the time to stop; a flooding sender leaves room for others.
"""

MAX_TOKENS = 20_000


def sender_of(sample: Any) -> int | None:
    """Return the agent of a sample's key; None if it is no agent's key."""
    source = parse_agent_key(str(sample.key_expr))
    return source[0] if source else None


def whose_key(agent: int | None) -> str:
    return "no agent's key" if agent is None else f"agent {agent}'s key"


class Arrivals:
    """A queue from the threads of Zenoh and of the pages, and for the request to stop, to the main thread."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[tuple[ArrivalKind, Any]] = queue.SimpleQueue()

    def stop(self) -> None:
        """Stop the main thread after the waiting items. Safe in a signal handler: it takes no lock."""
        self._queue.put((ArrivalKind.STOP, None))

    def put(self, arrival: ArrivalKind, sample: Any) -> None:
        self._queue.put((arrival, sample))

    def get(self, timeout_s: float) -> tuple[ArrivalKind, Any]:
        return self._queue.get(timeout=timeout_s)

    def __len__(self) -> int:
        return self._queue.qsize()


class BoundedArrivals(Arrivals):
    """A queue that refuses samples for lack of room, per sender and in total."""

    def __init__(self) -> None:
        super().__init__()
        self.refused: Counter[int | None] = Counter()
        """Reports and health messages refused for lack of room, by agent (None: no agent's key)."""
        self._lock = threading.Lock()
        self._waiting_bytes: Counter[int | None] = Counter()
        self._all_waiting_bytes = 0
        self._late_tokens: dict[str, Any] = {}

    def put(self, arrival: ArrivalKind, sample: Any) -> None:
        """Add a sample, or refuse it for lack of room. Of excess tokens the newest of each key is kept for later.

        Excess intents of the station are dropped; None, which says that it has gone, never is.
        """
        if arrival in BY:
            if sample is None:
                log.warning("the station has ended; the operator continues without it")
            if sample is None or len(self) < MAX_TOKENS:
                self._queue.put((arrival, sample))
            return
        if arrival is ArrivalKind.TOKEN:
            with self._lock:
                if len(self) < MAX_TOKENS:
                    self._queue.put((arrival, sample))
                else:
                    self._late_tokens[str(sample.key_expr)] = sample
            return
        sender, length = sender_of(sample), len(sample.payload)
        with self._lock:
            if self._has_room(sender, length):
                self._note(sender, length + SAMPLE_BYTES)
                self._queue.put((arrival, sample))
                return
            self.refused[sender] += 1
            is_first = self.refused[sender] == 1
        if is_first:
            why = "larger than any report" if length > MAX_SAMPLE_BYTES else "too many to process"
            log.warning("refused a sample on %s: %s (more are only counted)", whose_key(sender), why)

    def get(self, timeout_s: float) -> tuple[ArrivalKind, Any]:
        try:
            arrival, sample = self._queue.get_nowait()
        except queue.Empty:
            with self._lock:
                if self._late_tokens:
                    return ArrivalKind.TOKEN, self._late_tokens.pop(next(iter(self._late_tokens)))
            arrival, sample = self._queue.get(timeout=timeout_s)
        if arrival in (ArrivalKind.REPORT, ArrivalKind.HEALTH):
            with self._lock:
                self._note(sender_of(sample), -len(sample.payload) - SAMPLE_BYTES)
        return arrival, sample

    def _note(self, sender: int | None, change_bytes: int) -> None:
        self._all_waiting_bytes += change_bytes
        self._waiting_bytes[sender] += change_bytes
        if not self._waiting_bytes[sender]:
            del self._waiting_bytes[sender]

    def _has_room(self, sender: int | None, length: int) -> bool:
        needed = length + SAMPLE_BYTES
        return (
            length <= MAX_SAMPLE_BYTES
            and self._waiting_bytes[sender] + needed <= MAX_WAITING_BYTES_OF_ONE
            and self._all_waiting_bytes + needed <= MAX_WAITING_BYTES
        )
