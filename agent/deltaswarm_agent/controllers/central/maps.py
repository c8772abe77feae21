"""Where events are expected: learnt from those sensed so far, or known.

A map has places where events occur, for posts, and cells with the number of events that probably wait in each, for
patrols.
"""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deltaswarm_wire.settings import AgentSettings

Floats = NDArray[np.float64]

MAX_PLACES = 150
"""Posts follow at most this number of the latest events."""

MEMORY_S = 3000.0
"""Time constant with which events are forgotten."""

SPREAD_M = 5.0
"""Standard deviation with which an event counts for the cells around it."""

PRIOR_EVENTS = 2.0
"""Number of events, spread evenly, from which learning starts."""

MAX_CELLS = 2500
"""Cells are at least as wide as the sensing range, and wider in an arena that would have more of them than this."""


class Cells:
    """The arena in square cells; the expected number of events that wait in each, in the unit of a map's weights."""

    def __init__(self, task: AgentSettings) -> None:
        area_m2 = task.width_m * task.height_m
        cell_m = max(task.sensing_range_m, math.sqrt(area_m2 / MAX_CELLS))
        columns, rows = math.ceil(task.width_m / cell_m), math.ceil(task.height_m / cell_m)
        along_m = (np.arange(columns) + 0.5) * task.width_m / columns, (np.arange(rows) + 0.5) * task.height_m / rows
        self.centres_m: Floats = np.stack(np.meshgrid(*along_m), axis=-1).reshape(-1, 2)
        self.waiting: Floats = np.zeros(len(self.centres_m))
        self._range_m = task.sensing_range_m

    def pass_time(self, weights: Floats, time_s: float) -> None:
        """Let events arrive for some time."""
        self.waiting += weights * time_s

    def see(self, positions_m: Floats) -> None:
        """Note what agents at these positions (n, 2) see: nothing waits unsensed in their range."""
        offsets_m = self.centres_m[:, None] - positions_m
        self.waiting[((offsets_m**2).sum(axis=2) <= self._range_m**2).any(axis=1)] = 0.0


class LearntMap:
    """A map of the events that were sensed."""

    def __init__(self, cells: Cells) -> None:
        self._centres_m = cells.centres_m
        self._prior: Floats = np.full(len(cells.centres_m), PRIOR_EVENTS / len(cells.centres_m))
        self._learnt: Floats = np.zeros(len(cells.centres_m))
        self._decayed_s = 0.0
        self._latest: deque[tuple[float, float, float]] = deque(maxlen=MAX_PLACES)
        """Time [s] and position [m] of each event."""

    def learn(self, time_s: float, x_m: float, y_m: float) -> None:
        """Take the place of an event that becomes known [m]."""
        self._latest.append((time_s, x_m, y_m))
        squares = ((self._centres_m - (x_m, y_m)) ** 2).sum(axis=1)
        near = np.exp(-(squares - squares.min()) / (2.0 * SPREAD_M**2))
        self._decay(time_s)
        self._learnt += near / near.sum()

    def places_m(self, time_s: float) -> Floats:
        """Return the places of the latest events (n, 2) [m]."""
        while self._latest and time_s - self._latest[0][0] > MEMORY_S:
            self._latest.popleft()
        return np.array([(x_m, y_m) for _, x_m, y_m in self._latest]).reshape(-1, 2)

    def rate_near_hz(self, time_s: float, posts_m: Floats, range_m: float) -> Floats:
        """Return how often the latest events occurred within a range of each post [1/s]."""
        near = np.hypot(*(self.places_m(time_s)[:, None] - posts_m).transpose(2, 0, 1)) <= range_m
        over_s = time_s - self._latest[0][0] + 1.0 if self._latest else 1.0
        rates: Floats = near.sum(axis=0) / over_s
        return rates

    def weights(self, time_s: float) -> Floats:
        """Return the number of events learnt for each cell, the prior included."""
        self._decay(time_s)
        return self._prior + self._learnt

    def _decay(self, time_s: float) -> None:
        self._learnt *= math.exp(-(time_s - self._decayed_s) / MEMORY_S)
        self._decayed_s = time_s


class KnownMap:
    """A map of a density that is known: events occur at `rate_hz`, at places (n, 2) [m] like those that `sample` draws.

    A density that moves is sampled again every `anew_s`.
    """

    def __init__(
        self, cells: Cells, rate_hz: float, sample: Callable[[float], Floats], anew_s: float = math.inf
    ) -> None:
        self._centres_m, self._rate_hz, self._sample, self._anew_s = cells.centres_m, rate_hz, sample, anew_s
        self._sampled_s = -math.inf
        self._places_m = self._weights = np.zeros((0, 2))

    def learn(self, time_s: float, x_m: float, y_m: float) -> None:
        """Learn nothing: the density is known."""

    def places_m(self, time_s: float) -> Floats:
        self._draw(time_s)
        return self._places_m

    def rate_near_hz(self, time_s: float, posts_m: Floats, range_m: float) -> Floats:
        near = np.hypot(*(self.places_m(time_s)[:, None] - posts_m).transpose(2, 0, 1)) <= range_m
        rates: Floats = near.mean(axis=0) * self._rate_hz
        return rates

    def weights(self, time_s: float) -> Floats:
        """Return the rate of events in each cell [1/s]; one more event, spread evenly, keeps all above 0."""
        self._draw(time_s)
        return self._weights

    def _draw(self, time_s: float) -> None:
        if self._sampled_s > -math.inf and time_s - self._sampled_s < self._anew_s:
            return
        self._sampled_s, self._places_m = time_s, self._sample(time_s)
        cells = ((self._places_m[:, None] - self._centres_m) ** 2).sum(axis=2).argmin(axis=1)
        counts = np.bincount(cells, minlength=len(self._centres_m)) + 1.0 / len(self._centres_m)
        self._weights = counts * self._rate_hz / len(cells)


Expected = LearntMap | KnownMap
"""What a planner knows of the events to come."""
