"""Faults of an agent's sensor: blind, noisy, lying."""

import math
from collections.abc import Sequence

import numpy as np

from deltaswarm_scenario.fault import BLIND, LYING, NOISY
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.codec import MAX_ID
from deltaswarm_wire.messages import Event
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.event_ids import EventIds
from deltaswarm_world.core.faults.kind import ActiveFault, Kind, Orders

FIRST_PHANTOM = MAX_ID
"""Phantoms are numbered downwards from here, events upwards from 0, before both get opaque ids."""


class Blind(Kind):
    """The agent senses nothing."""

    name = BLIND

    @property
    def blind(self) -> frozenset[int]:
        """See `Kind`."""
        return self.agents


class Noisy(Kind):
    """Each event is sensed with a position error, or missed in some steps."""

    name = NOISY

    def __init__(self, scenario: Scenario, orders: Orders) -> None:
        super().__init__(scenario, orders)
        self._missing: dict[int, list[ActiveFault]] = {}
        self._noisy: dict[int, list[ActiveFault]] = {}
        self._errors_m: dict[tuple[int, int, int], tuple[float, float]] = {}

    def look(self, faults: Sequence[ActiveFault]) -> None:
        """See `Kind`."""
        super().look(faults)
        self._missing, self._noisy = {}, {}
        for fault in faults:
            for agent in sorted(fault.agents):
                if fault.fault.miss is not None:
                    self._missing.setdefault(agent, []).append(fault)
                if fault.fault.noise_m is not None:
                    self._noisy.setdefault(agent, []).append(fault)

    def misses(self, agent: int) -> bool:
        """See `Kind`."""
        faults = self._missing.get(agent)
        return faults is not None and any(fault.rng.random() < (fault.fault.miss or 0.0) for fault in faults)

    def distort(self, sensed: Sequence[list[Event]], positions_m: Floats) -> None:
        """See `Kind`."""
        for agent, faults in self._noisy.items():
            for fault in faults:
                sensed[agent][:] = [self._displaced(event, agent, fault) for event in sensed[agent]]

    def _displaced(self, event: Event, agent: int, fault: ActiveFault) -> Event:
        """Return a constant error: with a new error each step agents would never arrive."""
        key = (fault.index, agent, event.event)
        if key not in self._errors_m:
            dx_m, dy_m = (fault.rng.standard_normal(2) * (fault.fault.noise_m or 0.0)).tolist()
            self._errors_m[key] = dx_m, dy_m
        dx_m, dy_m = self._errors_m[key]
        return Event(event.event, *_in_arena(self._scenario, event.x_m + dx_m, event.y_m + dy_m))


class Lying(Kind):
    """The sensor shows nonexistent events. Of two lies the later one in the scenario applies."""

    name = LYING

    def __init__(self, scenario: Scenario, orders: Orders) -> None:
        super().__init__(scenario, orders)
        self._range_m = scenario.agents.sensing_range_m
        self._liars: dict[int, ActiveFault] = {}
        self._phantoms: dict[int, list[Event]] = {}
        self._next = FIRST_PHANTOM
        self._ids = EventIds(scenario.seed)

    def look(self, faults: Sequence[ActiveFault]) -> None:
        """See `Kind`."""
        super().look(faults)
        self._liars = {agent: fault for fault in faults for agent in sorted(fault.agents)}
        self._phantoms = {agent: self._phantoms.get(agent, []) for agent in sorted(self._liars)}

    def distort(self, sensed: Sequence[list[Event]], positions_m: Floats) -> None:
        """See `Kind`. A phantom out of range is replaced."""
        for agent, fault in self._liars.items():
            x_m, y_m = positions_m[agent].tolist()
            phantoms = [event for event in self._phantoms[agent] if self._is_near(event, x_m, y_m)]
            while len(phantoms) < (fault.fault.phantoms or 0):
                phantoms.append(self._phantom(x_m, y_m, fault.rng))
            self._phantoms[agent] = phantoms
            sensed[agent].extend(phantoms)

    def _phantom(self, x_m: float, y_m: float, rng: np.random.Generator) -> Event:
        radius_m = self._range_m * float(rng.random()) ** 0.5
        angle = 2 * math.pi * float(rng.random())
        place = _in_arena(self._scenario, x_m + radius_m * math.cos(angle), y_m + radius_m * math.sin(angle))
        phantom = Event(self._ids.of(self._next), *place)
        self._next -= 1
        return phantom

    def _is_near(self, event: Event, x_m: float, y_m: float) -> bool:
        return (event.x_m - x_m) ** 2 + (event.y_m - y_m) ** 2 <= self._range_m**2


def _in_arena(scenario: Scenario, x_m: float, y_m: float) -> tuple[float, float]:
    return min(max(x_m, 0.0), scenario.arena.width_m), min(max(y_m, 0.0), scenario.arena.height_m)
