"""Arrivals of events: when, where, under which id, and of which class.

Times are a Poisson process in continuous time with a generator of its own, so the step cannot shift them; another rate
scales them from when it holds on. Each event's place has a generator of its own, so an obstacle or another density
moves only the events that it affects. It is drawn from the density at the time of arrival. Neither depends on the
swarm, the radio or a fault.
"""

import hashlib
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from itertools import accumulate, pairwise
from math import floor
from typing import NamedTuple

import numpy as np

from deltaswarm_scenario.scenario import EventSettings, Scenario
from deltaswarm_scenario.task import TaskSettings
from deltaswarm_wire.messages import Event
from deltaswarm_wire.seeds import derived_key
from deltaswarm_world.core.arrays import Floats, generator
from deltaswarm_world.core.density import Places

ROUNDS = 4
_HALF_BITS = 16
_HALF = (1 << _HALF_BITS) - 1


class EventIds:
    """A keyed permutation of the numbers below 2^32 (a Feistel network), the same for the same seed of the run."""

    def __init__(self, seed: int) -> None:
        self._key = derived_key(seed, "event ids")

    def of(self, number: int) -> int:
        """Return the id of the n-th event to arrive, counted from 0."""
        left, right = number >> _HALF_BITS, number & _HALF
        for turn in range(ROUNDS):
            left, right = right, left ^ self._mixed(turn, right)
        return left << _HALF_BITS | right

    def _mixed(self, turn: int, half: int) -> int:
        data = bytes((turn, half & 0xFF, half >> 8))
        return int.from_bytes(hashlib.blake2b(data, key=self._key, digest_size=2).digest(), "little")


TIMES_STREAM, PLACES_STREAM = 1, 4


class Arrival(NamedTuple):
    event: int
    x_m: float
    y_m: float
    time_s: float


class Expected:
    """The number of events that are expected by a time, at rates that may change in the run."""

    def __init__(self, settings: EventSettings) -> None:
        self._from_s = (0.0, *settings.rates_s)
        self._rates_hz = (settings.rate_hz, *settings.rates_hz)
        spans_s = (end_s - start_s for start_s, end_s in pairwise(self._from_s))
        counts = (span_s * rate_hz for span_s, rate_hz in zip(spans_s, self._rates_hz, strict=False))
        self._before = tuple(accumulate(counts, initial=0.0))
        """The number expected before each rate begins."""

    def by(self, time_s: float) -> float:
        part = bisect_right(self._from_s, time_s) - 1
        return self._before[part] + (time_s - self._from_s[part]) * self._rates_hz[part]

    def time_s(self, number: float) -> float:
        """Return the time by which a number is expected [s]; it must be reached."""
        part = max(0, bisect_left(self._before, number) - 1)  # where the rate is 0 the number does not grow
        return self._from_s[part] + (number - self._before[part]) / self._rates_hz[part]


class Arrivals:
    """The arrivals of one run, in order."""

    def __init__(self, scenario: Scenario, places: Places) -> None:
        self._seed = scenario.seed
        self._expected = Expected(scenario.events)
        self._places = places
        self._ids = EventIds(scenario.seed)
        self._times = generator(scenario.seed, TIMES_STREAM)
        self._count = 0
        self._next = float(self._times.standard_exponential())
        """The next event arrives when this number is expected."""

    def until(self, time_s: float) -> Iterator[Arrival]:
        """Yield the events that have arrived since the last call, up to a time [s]."""
        while self._next <= self._expected.by(time_s):
            arrived_s = self._expected.time_s(self._next)
            place_m = self._places.draw(generator(self._seed, PLACES_STREAM, self._count), arrived_s)
            yield Arrival(self._ids.of(self._count), *place_m, arrived_s)
            self._count += 1
            self._next += float(self._times.standard_exponential())

    def redraw(self, seed: int, time_s: float) -> None:
        """Redraw all arrivals after a time [s] with another seed; the ids of events stay."""
        self._seed, self._times = seed, generator(seed, TIMES_STREAM)
        self._next = self._expected.by(time_s) + float(self._times.standard_exponential())


CLASS_STREAM, JUMP_STREAM = 5, 6


class EventClasses:
    """The class of each event, and where it is sensed. All follows from seed, event and time, so nothing is saved."""

    def __init__(self, task: TaskSettings, seed: int, size_m: Floats) -> None:
        self._task, self._seed, self._size_m = task, seed, size_m
        self._jumps_m: dict[int, float] = {}
        self._targets: dict[int, bool] = {}
        """The classes of events that are not drawn again."""

    def is_target(self, event: int) -> bool:
        if event in self._targets:
            return self._targets[event]
        return bool(generator(self._seed, CLASS_STREAM, event).random() < self._task.target_share)

    def redraw(self, seed: int, arrived: Iterable[int]) -> None:
        """Redraw with another seed, except the classes of the events that have arrived."""
        self._targets = {event: self.is_target(event) for event in arrived}
        self._seed = seed

    def interval(self, time_s: float) -> int:
        """Return the number of the interval in which sensed places stay the same."""
        return floor(time_s / self._task.jump_every_s + 1e-9)

    def as_sensed(self, event: int, x_m: float, y_m: float, interval: int) -> Event:
        """Return an event at the place where it is sensed in an interval, within the arena."""
        if event not in self._jumps_m:
            self._jumps_m[event] = self._task.target_jump_m if self.is_target(event) else self._task.decoy_jump_m
        error_m = self._jumps_m[event] * generator(self._seed, JUMP_STREAM, event, interval).standard_normal(2)
        place_m = np.minimum(np.maximum(error_m + np.array((x_m, y_m)), 0.0), self._size_m)
        return Event(event, *place_m.tolist())
