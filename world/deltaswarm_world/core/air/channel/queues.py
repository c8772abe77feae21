"""Frames in flight: waiting for bandwidth, or delayed."""

import math
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from deltaswarm_scenario.operator_links import DownlinkSettings, UplinkSettings
from deltaswarm_scenario.radio import RadioSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.air.channel.links import Diagnosis
from deltaswarm_world.core.arrays import generator


class Packet(NamedTuple):
    """One frame in flight. Packets sort by sender, then age; a copy has its original's number."""

    sender: int
    number: int
    data: bytes


Arrival = tuple[int, Packet]
"""A receiver and its packet."""


class RateLimitedQueue:
    """One first-in, first-out queue per end, with a limit of bytes per step.

    Excess bytes wait, up to a capacity; a frame beyond the capacity is dropped. A long frame takes several steps.
    Unused capacity of a step does not carry over.
    """

    def __init__(self, bytes_per_step: float, queue_bytes: int) -> None:
        self.passed_bytes = 0
        self.waiting = 0
        """Waiting packets at all ends."""
        self._bytes_per_step = bytes_per_step
        self._queue_bytes = queue_bytes
        self._queues: dict[int, deque[Packet]] = {}
        self._credits: dict[int, float] = {}
        """Passed bytes of the first packet of each nonempty queue."""

    @property
    def ends(self) -> list[int]:
        return sorted(self._queues)

    def take(self, end: int, arriving: list[Packet]) -> tuple[list[Packet], list[Packet]]:
        """Run one step of one end, once per step; return passed and dropped packets in order."""
        credit = self._credits.pop(end, 0.0) + self._bytes_per_step
        queue = self._queues.pop(end, deque())
        before = len(queue)
        queue.extend(arriving)
        passed = []
        while queue and (size := len(queue[0].data)) <= credit:
            credit -= size
            self.passed_bytes += size
            passed.append(queue.popleft())
        if not queue:
            self.waiting -= before
            return passed, []
        kept, room, dropped = deque[Packet](), self._queue_bytes, []
        for packet in queue:
            if (size := len(packet.data)) <= room:
                room -= size
                kept.append(packet)
            else:
                dropped.append(packet)
        self.waiting += len(kept) - before
        if kept:
            self._queues[end] = kept
            if kept[0] is queue[0]:
                self._credits[end] = credit
        return passed, dropped

    def pass_wide(self, loads: Mapping[int, int]) -> list[int]:
        """Run one step of all ends where everything passes, given the arriving bytes per end.

        Returns the other ends, ascending, for which the caller runs the step.
        """
        narrow = {end for end, load in loads.items() if load > self._bytes_per_step} | self._queues.keys()
        self.passed_bytes += sum(loads.values()) - sum([loads.get(end, 0) for end in narrow])
        return sorted(narrow)

    def clear(self, end: int) -> list[Packet]:
        self._credits.pop(end, None)
        gone = list(self._queues.pop(end, ()))
        self.waiting -= len(gone)
        return gone

    def holds(self, end: int) -> list[Packet]:
        return list(self._queues.get(end, ()))

    def explain(self, end: int, whose: str) -> Diagnosis:
        held = sum(len(packet.data) for packet in self.holds(end))
        says = f"the {whose}'s radio passes {self._bytes_per_step:g} bytes in a step; {held} bytes wait in its queue"
        numbers = {"end": whose, "bytes_per_step": self._bytes_per_step, "waiting_bytes": held}
        return Diagnosis("bandwidth", False, says, numbers)


class DelayLine:
    """Delays frames by a minimum and a uniform jitter.

    Delays are rounded at random to whole steps, so that the mean is latency + jitter / 2 for any step length.

    Args:
        latency_s: minimum delay [s].
        jitter_s: maximum additional delay [s].
        step_s: length of a step [s].
        rng: draws the jitter.
        rounding_rng: draws for delays that are not whole steps.
    """

    def __init__(
        self,
        latency_s: float,
        jitter_s: float,
        step_s: float,
        rng: np.random.Generator,
        rounding_rng: np.random.Generator,
    ) -> None:
        self.waiting = 0
        self._latency = _snapped(latency_s / step_s)
        self._jitter = _snapped(jitter_s / step_s)
        self._rng, self._rounding_rng = rng, rounding_rng
        self._due: defaultdict[int, list[Arrival]] = defaultdict(list)

    def draw(self, count: int) -> npt.NDArray[np.int64]:
        """Return delays [steps] of some frames; no draw without jitter and with a latency of whole steps."""
        if self._jitter == 0.0 and self._latency.is_integer():
            return np.full(count, int(self._latency))
        delays = self._latency + self._rounding_rng.random(count)
        if self._jitter > 0.0:
            delays += self._jitter * self._rng.random(count)
        return np.floor(delays).astype(np.int64)

    def send(self, step: int, arrivals: Iterable[tuple[int, Packet]], delays: Iterable[int]) -> list[Arrival]:
        """Keep delayed packets until their step; return the others as (receiver, packet)."""
        by_delay: defaultdict[int, list[Arrival]] = defaultdict(list)
        for arrival, delay in zip(arrivals, delays, strict=True):
            by_delay[delay].append(arrival)
        at_once = by_delay.pop(0, [])
        for delay, held in by_delay.items():
            self.waiting += len(held)
            self._due[step + delay] += held
        return at_once

    def take(self, step: int) -> list[Arrival]:
        """Return the packets due in this step as (receiver, packet). Call it for every step in order."""
        due = self._due.pop(step, [])
        self.waiting -= len(due)
        return due

    def explain(self) -> Diagnosis:
        least, most = math.floor(self._latency), math.ceil(self._latency + self._jitter)
        mean = self._latency + self._jitter / 2
        says = f"frames arrive {least} to {most} steps later than without delay, {mean:g} on average"
        return Diagnosis("delay", False, says, {"steps_min": least, "steps_max": most, "steps_mean": mean})

    def due_of(self, sender: int, receiver: int) -> list[int]:
        """Return the steps in which packets from one end to another are due, ascending."""
        return sorted(
            step
            for step, held in self._due.items()
            for end, packet in held
            if end == receiver and packet.sender == sender
        )


def queue_of(bytes_per_s: float, queue_bytes: int, step_s: float) -> RateLimitedQueue | None:
    """Make a queue; None if the rate is 0, which means that there is no limit."""
    return RateLimitedQueue(bytes_per_s * step_s, queue_bytes) if bytes_per_s > 0 else None


def delays_of(
    settings: RadioSettings | UplinkSettings | DownlinkSettings, scenario: Scenario, jitter: int, rounding: int
) -> DelayLine:
    """Make the delays of a link, with generators of these streams."""
    rngs = [generator(scenario.seed, stream) for stream in (jitter, rounding)]
    return DelayLine(settings.latency_s, settings.jitter_s, scenario.run.step_s, *rngs)


def _snapped(steps: float) -> float:
    """Return a whole number of steps if only rounding prevents one, as for 0.3 s / 0.1 s."""
    whole = round(steps)
    return float(whole) if abs(steps - whole) < 1e-9 else steps
