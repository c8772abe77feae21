"""Arrivals of events: when, where, and under which id.

Times are a Poisson process in continuous time with a generator of its own, so the step cannot shift them; another rate
scales them. Each event's place has a generator of its own, so an obstacle or another density moves only the events
that it affects. It is drawn from the density at the time of arrival. Neither depends on the swarm, the radio or a
fault.
"""

from collections.abc import Iterator
from typing import NamedTuple

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.chance import generator
from deltaswarm_world.core.density import Places
from deltaswarm_world.core.event_ids import EventIds

TIMES_STREAM, PLACES_STREAM = 1, 4


class Arrival(NamedTuple):
    """One event that arrives."""

    event: int
    x_m: float
    y_m: float
    time_s: float


class Arrivals:
    """The arrivals of one run, in order."""

    def __init__(self, scenario: Scenario, places: Places) -> None:
        self._seed = scenario.seed
        self._rate_hz = scenario.events.rate_hz
        self._places = places
        self._ids = EventIds(scenario.seed)
        self._times = generator(scenario.seed, TIMES_STREAM)
        self._count = 0
        self._next = float(self._times.standard_exponential())
        """When the next event arrives, in mean times between events."""

    def until(self, time_s: float) -> Iterator[Arrival]:
        """Yield the events that have arrived since the last call, up to a time [s]."""
        while self._next <= time_s * self._rate_hz:
            arrived_s = self._next / self._rate_hz
            place_m = self._places.draw(generator(self._seed, PLACES_STREAM, self._count), arrived_s)
            yield Arrival(self._ids.of(self._count), *place_m, arrived_s)
            self._count += 1
            self._next += float(self._times.standard_exponential())
