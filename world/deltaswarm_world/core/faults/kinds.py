"""The faults of an agent: of its process, which act through orders, of its drive and radio, and of its sensor."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from deltaswarm_scenario.fault import MUST_END, NEVER_ENDS
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, key
from deltaswarm_wire.codec import MAX_ID
from deltaswarm_wire.messages import Event
from deltaswarm_wire.orders import GO_ON, KILL, NOTE, START, STOP
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.arrivals import EventIds
from deltaswarm_world.core.faults.kind import ActiveFault, Kind, Orders


class Kill(Kind):
    """The process ends for good; the body stops where it is."""

    lasts = NEVER_ENDS
    to_process = True
    hits_dead = False
    kills = True

    def begin(self, fault: ActiveFault, living: set[int], why: str) -> bool:
        targets = fault.agents & living
        self._orders.add(KILL if targets else NOTE, targets, why)
        living -= targets
        return False


class Restart(Kind):
    """The process ends, and a new one begins: at once, or after the duration."""

    to_process = True
    kills = True

    def begin(self, fault: ActiveFault, living: set[int], why: str) -> bool:
        """See `Kind`. Also starts agents without a process."""
        self._orders.add(KILL, fault.agents & living, why)
        living -= fault.agents
        if fault.end is None:
            self._orders.add(START, fault.agents, why)
            living |= fault.agents
        if not fault.agents:
            self._orders.add(NOTE, (), why)
        return fault.end is not None

    def end(self, fault: ActiveFault, living: set[int]) -> None:
        self._orders.add(START, fault.agents - living, "restart after a while")
        living |= fault.agents


class Freeze(Kind):
    """The process stops and continues; overlapping freezes merge."""

    lasts = MUST_END
    to_process = True
    hits_dead = False

    def begin(self, fault: ActiveFault, living: set[int], why: str) -> bool:
        """See `Kind`; `look` gives the order."""
        if not fault.agents:
            self._orders.add(NOTE, (), why)
        return True

    def end(self, fault: ActiveFault, living: set[int]) -> None:
        """See `Kind`; `look` gives the order."""

    def see_killed(self, targets: Collection[int], faults: Sequence[ActiveFault]) -> None:
        """See `Kind`. A killed process is not frozen any more."""
        self.agents = self.agents.difference(targets)
        for fault in faults:
            fault.agents.difference_update(targets)

    def look(self, faults: Sequence[ActiveFault]) -> None:
        before = self.agents
        super().look(faults)
        self._orders.add(GO_ON, before - self.agents, "freeze ends")
        self._orders.add(STOP, self.agents - before, self.name)

    @property
    def blind(self) -> frozenset[int]:
        return self.agents


STANDING = (0.0, 0.0)
"""Velocity of a body at rest [m/s]."""


@dataclass(frozen=True)
class SlowSettings:
    factor: float | None = key(None, "remaining share of the commanded speed", low=0, high=1)

    def problems(self) -> list[Problem]:
        return [Problem("factor", "nothing", "must be given")] if self.factor is None else []


class Slow(Kind):
    """The body moves at a share of the commanded speed; shares multiply."""

    Settings = SlowSettings

    def __init__(self, name: str, scenario: Scenario, orders: Orders) -> None:
        super().__init__(name, scenario, orders)
        self._factors: list[tuple[list[int], float]] = []

    def look(self, faults: Sequence[ActiveFault]) -> None:
        super().look(faults)
        self._factors = [(sorted(fault.agents), fault.settings.factor) for fault in faults]

    def drive(self, velocities_mps: Floats) -> None:
        for agents, factor in self._factors:
            velocities_mps[agents] *= factor


class Stuck(Kind):
    """The body keeps its velocity from the start of the fault and ignores commands."""

    def __init__(self, name: str, scenario: Scenario, orders: Orders) -> None:
        super().__init__(name, scenario, orders)
        self._kept_mps: dict[int, tuple[float, float]] = {}

    def look(self, faults: Sequence[ActiveFault]) -> None:
        """See `Kind`. A body stuck from the first step on never moves."""
        super().look(faults)
        self._kept_mps = {agent: kept for agent, kept in self._kept_mps.items() if agent in self.agents}
        for fault in faults:
            if fault.fault.begins(self._scenario.run.step_s) == 0:
                self._kept_mps |= dict.fromkeys(fault.agents, STANDING)

    def drive(self, velocities_mps: Floats) -> None:
        for agent in self.agents - self._kept_mps.keys():
            vx_mps, vy_mps = velocities_mps[agent].tolist()
            self._kept_mps[agent] = vx_mps, vy_mps
        for agent, kept in self._kept_mps.items():
            velocities_mps[agent] = kept


class RadioDead(Kind):
    """The radio neither sends nor receives."""

    @property
    def deaf(self) -> frozenset[int]:
        return self.agents


FIRST_PHANTOM = MAX_ID
"""Phantoms are numbered downwards from here, events upwards from 0, before both get opaque ids."""


class Blind(Kind):
    @property
    def blind(self) -> frozenset[int]:
        return self.agents


@dataclass(frozen=True)
class NoisySettings:
    noise_m: float | None = key(
        None, "standard deviation of each event's constant position error along x and y [m]", above=0, high=1e5
    )
    miss: float | None = key(None, "probability of missing an event in a step", above=0, high=1)

    def problems(self) -> list[Problem]:
        is_given = self.noise_m is not None or self.miss is not None
        return [] if is_given else [Problem("noise_m", "nothing", "must be given, or else miss")]


class Noisy(Kind):
    """Each event is sensed with a position error, or missed in some steps."""

    Settings = NoisySettings

    def __init__(self, name: str, scenario: Scenario, orders: Orders) -> None:
        super().__init__(name, scenario, orders)
        self._missing: dict[int, list[ActiveFault]] = {}
        self._noisy: dict[int, list[ActiveFault]] = {}
        self._errors_m: dict[tuple[int, int, int], tuple[float, float]] = {}

    def look(self, faults: Sequence[ActiveFault]) -> None:
        super().look(faults)
        self._missing, self._noisy = {}, {}
        for fault in faults:
            for agent in sorted(fault.agents):
                if fault.settings.miss is not None:
                    self._missing.setdefault(agent, []).append(fault)
                if fault.settings.noise_m is not None:
                    self._noisy.setdefault(agent, []).append(fault)

    def misses(self, agent: int) -> bool:
        faults = self._missing.get(agent)
        return faults is not None and any(fault.rng.random() < fault.settings.miss for fault in faults)

    def distort(self, sensed: Sequence[list[Event]], positions_m: Floats) -> None:
        for agent, faults in self._noisy.items():
            for fault in faults:
                sensed[agent][:] = [self._displaced(event, agent, fault) for event in sensed[agent]]

    def _displaced(self, event: Event, agent: int, fault: ActiveFault) -> Event:
        """Return a constant error: with a new error each step agents would never arrive."""
        key = (fault.index, agent, event.event)
        if key not in self._errors_m:
            dx_m, dy_m = (fault.rng.standard_normal(2) * fault.settings.noise_m).tolist()
            self._errors_m[key] = dx_m, dy_m
        dx_m, dy_m = self._errors_m[key]
        return Event(event.event, *_in_arena(self._scenario, event.x_m + dx_m, event.y_m + dy_m))


@dataclass(frozen=True)
class LyingSettings:
    phantoms: int | None = key(None, "number of nonexistent events that the agent senses", low=1, high=64)

    def problems(self) -> list[Problem]:
        return [Problem("phantoms", "nothing", "must be given")] if self.phantoms is None else []


class Lying(Kind):
    """The sensor shows nonexistent events. Of two lies the one that began later applies."""

    Settings = LyingSettings

    def __init__(self, name: str, scenario: Scenario, orders: Orders) -> None:
        super().__init__(name, scenario, orders)
        self._range_m = scenario.agents.sensing_range_m
        self._liars: dict[int, ActiveFault] = {}
        self._phantoms: dict[int, list[Event]] = {}
        self._next = FIRST_PHANTOM
        self._ids = EventIds(scenario.seed)

    def look(self, faults: Sequence[ActiveFault]) -> None:
        super().look(faults)
        self._liars = {agent: fault for fault in faults for agent in sorted(fault.agents)}
        self._phantoms = {agent: self._phantoms.get(agent, []) for agent in sorted(self._liars)}

    def distort(self, sensed: Sequence[list[Event]], positions_m: Floats) -> None:
        """See `Kind`. A phantom out of range is replaced."""
        for agent, fault in self._liars.items():
            x_m, y_m = positions_m[agent].tolist()
            phantoms = [event for event in self._phantoms[agent] if self._is_near(event, x_m, y_m)]
            while len(phantoms) < fault.settings.phantoms:
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
