"""Faults of an agent's drive and radio."""

from collections.abc import Sequence
from dataclasses import dataclass

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, key
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.faults.kind import ActiveFault, Kind, Orders

STANDING = (0.0, 0.0)
"""Velocity of a body at rest [m/s]."""


@dataclass(frozen=True)
class SlowSettings:
    """The keys of actuator-slow."""

    factor: float | None = key(None, "remaining share of the commanded speed", low=0, high=1)

    def problems(self) -> list[Problem]:
        """The factor must be given."""
        return [Problem("factor", "nothing", "must be given")] if self.factor is None else []


class Slow(Kind):
    """The body moves at a share of the commanded speed; shares multiply."""

    Settings = SlowSettings

    def __init__(self, name: str, scenario: Scenario, orders: Orders) -> None:
        super().__init__(name, scenario, orders)
        self._factors: list[tuple[list[int], float]] = []

    def look(self, faults: Sequence[ActiveFault]) -> None:
        """See `Kind`."""
        super().look(faults)
        self._factors = [(sorted(fault.agents), fault.settings.factor) for fault in faults]

    def drive(self, velocities_mps: Floats) -> None:
        """See `Kind`."""
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
        """See `Kind`."""
        for agent in self.agents - self._kept_mps.keys():
            vx_mps, vy_mps = velocities_mps[agent].tolist()
            self._kept_mps[agent] = vx_mps, vy_mps
        velocities_mps[list(self._kept_mps)] = list(self._kept_mps.values())


class RadioDead(Kind):
    """The radio neither sends nor receives."""

    @property
    def deaf(self) -> frozenset[int]:
        """See `Kind`."""
        return self.agents
