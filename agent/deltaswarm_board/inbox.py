"""Frames received through open air since the last step: checked, counted, the newest of each neighbour.

The radio decides which frames arrive. Dropped here are only frames that no radio would deliver: malformed frames,
frames on no agent's key, frames delayed in a dead link, and optionally those from senders out of range.
"""

import math
from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

from deltaswarm_wire.codec import MAX_RADIO_BYTES, WireError
from deltaswarm_wire.envelope import decode_sample, decode_sent
from deltaswarm_wire.messages import Heard

MAX_NEIGHBOURS = 256
"""Maximum number of senders in one step; bounds the memory that strangers can use."""

MAX_KNOWN = 4096
"""Maximum number of senders' clocks to remember."""

CLOCK_DRIFT = 1e-3
"""Bound on the relative drift of two boards' clocks [s/s]."""

STEADY_S, SETTLES_S = 1.0, 10.0
"""An offset (arrival less sending) that varies by less than the first for the second becomes the usual offset [s]."""


MAX_RATE_HZ, MAX_BURST = 200.0, 256.0
"""Limits on the frames of one sender: an agent takes at most 100 steps per second, and a link may stall."""

TOO_MANY = f"over {MAX_RATE_HZ:g} per second"

MAX_TOLD = 256
"""Maximum number of logged pairs of sender and reason; the rest is only counted."""


@dataclass
class _Sender:
    """A neighbour's clock: the smallest offset (arrival less sending) [s], and when it was updated.

    Since `steady_since_s` the offset has been near `steady_s`, with the minimum `steady_least_s`.
    """

    least_s: float
    seen_s: float
    sent_s: float
    steady_s: float
    steady_least_s: float
    steady_since_s: float


class _Arrival(NamedTuple):
    """A sender's newest frame: counter, arrival time [s], sender's position [m] if known, bytes."""

    counter: int
    arrived_s: float
    place_m: tuple[float, float] | None
    data: bytes


class Lateness:
    """Measures how much longer than usual a frame was under way, without synchronised clocks.

    The offset (arrival by the receiver's clock less sending by the sender's) is the difference of the clocks plus the
    delay. The smallest offset seen has the usual delay. It may grow slowly, since clocks drift, and at once to a value
    that then stays: a board that was suspended has lost time. The offset of frames from a dead link does not stay: they
    catch up. A sender whose clock went back has restarted.
    """

    def __init__(self) -> None:
        self._known: dict[int, _Sender] = {}

    def of(self, sender: int, sent_s: float, now_s: float) -> float:
        """Return the lateness of a frame that arrives now [s]; 0 for a sender's first frame."""
        known = self._known.get(sender)
        offset_s = now_s - sent_s
        if known is None or sent_s < known.sent_s:
            if known is None and len(self._known) >= MAX_KNOWN:
                self._known.pop(next(iter(self._known)))
            self._known[sender] = _Sender(offset_s, now_s, sent_s, offset_s, offset_s, now_s)
            return 0.0
        known.least_s = min(offset_s, known.least_s + CLOCK_DRIFT * (now_s - known.seen_s))
        known.seen_s, known.sent_s = now_s, sent_s
        if abs(offset_s - known.steady_s) > STEADY_S:
            known.steady_s = known.steady_least_s = offset_s
            known.steady_since_s = now_s
        known.steady_least_s = min(known.steady_least_s, offset_s)
        if now_s - known.steady_since_s >= SETTLES_S:
            known.least_s = max(known.least_s, known.steady_least_s)
        return offset_s - known.least_s


class Allowance:
    """A rate limit per sender: `MAX_RATE_HZ` on average, `MAX_BURST` at once."""

    def __init__(self) -> None:
        self.left: dict[int | None, tuple[float, float]] = {}

    def spend(self, sender: int | None, now_s: float) -> bool:
        """Whether one more frame is allowed now [s]."""
        left, since_s = self.left.pop(sender, (MAX_BURST, now_s))
        left = min(MAX_BURST, left + MAX_RATE_HZ * (now_s - since_s))
        if len(self.left) >= MAX_KNOWN:
            self.left.pop(next(iter(self.left)))  # the least recent sender
        self.left[sender] = (max(0.0, left - 1.0), now_s)
        return left >= 1.0


class RadioInbox:
    """The frames for the next step. Not thread-safe; its owner locks it."""

    def __init__(self, agent: int, stale_s: float, range_m: float = 0.0, step_s: float = 0.0) -> None:
        self.dropped: Counter[str] = Counter()
        """Dropped frames by reason."""
        self.heard = 0
        """Frames that reached the agent."""
        self._agent = agent
        self._stale_s = stale_s
        self._range_m = range_m
        self._waits_s = step_s + stale_s
        """For how long a frame may wait here: for a step, and no longer than the agent may be late."""
        self._lateness = Lateness()
        self._allowance = Allowance()
        self._told: set[tuple[int | None, str]] = set()
        self._newest: dict[int, _Arrival] = {}

    def refuse(self, sender: int | None, now_s: float) -> str:
        """Return the reason to drop a sample that arrives now [s] unread, or "".

        This bounds the cost of a sender that floods its key.
        """
        if self._allowance.spend(sender, now_s):
            return ""
        self.dropped[TOO_MANY] += 1
        return TOO_MANY

    def is_news(self, sender: int | None, reason: str) -> bool:
        """Whether to log this sender and reason: not logged before, and the limit is not reached."""
        if (sender, reason) in self._told or len(self._told) >= MAX_TOLD:
            return False
        self._told.add((sender, reason))
        return True

    def accept(self, sender: int | None, data: bytes, sent: bytes | None, now_s: float) -> str:
        """Take a sample that arrives now [s] on this sender's key (None: no agent's key).

        Returns: why it is dropped, or "".
        """
        reason = self._fault(sender, data, sent, now_s)
        if reason:
            self.dropped[reason] += 1
        return reason

    def _fault(self, sender: int | None, data: bytes, sent: bytes | None, now_s: float) -> str:
        if len(data) > MAX_RADIO_BYTES:
            return "oversized"
        try:
            counter = decode_sample(data).counter
            sender_state = None if sent is None else decode_sent(sent)
        except WireError:
            return "malformed"
        if sender is None:
            return "on no agent's key"
        if sender == self._agent:
            return "from another agent with this number"
        if sender_state is not None and self._lateness.of(sender, sender_state.sent_s, now_s) > self._stale_s:
            return "stale"
        before = self._newest.get(sender)
        if before is None and len(self._newest) >= MAX_NEIGHBOURS:
            return "frame_full"
        if before is None or counter > before.counter:
            place_m = None if sender_state is None else (sender_state.x_m, sender_state.y_m)
            self._newest[sender] = _Arrival(counter, now_s, place_m, data)
        return ""

    def empty(self, now_s: float, place_m: tuple[float, float]) -> tuple[Heard, ...]:
        """Take the frames since the last step, for the step at `now_s` of an agent at `place_m`."""
        heard = []
        for sender, arrival in self._newest.items():
            if now_s - arrival.arrived_s > self._waits_s:
                self.dropped["stale"] += 1
            elif self._range_m and not _is_within(self._range_m, place_m, arrival.place_m):
                self.dropped["out of range"] += 1
            else:
                heard.append((sender, arrival.data))
        self._newest.clear()
        self.heard += len(heard)
        return tuple(heard)


def _is_within(range_m: float, place_m: tuple[float, float], other_m: tuple[float, float] | None) -> bool:
    """Whether a sender's position is known and within range."""
    return other_m is not None and math.dist(place_m, other_m) <= range_m
