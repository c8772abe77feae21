"""Faults of bodies with wheels or rotors, as kinds of `[[fault]]`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, key
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.faults.kind import ActiveFault, Kind, Orders


@dataclass(frozen=True)
class WheelLostSettings:
    wheel: str = key("left", "the wheel that does not turn any more", choices=("left", "right"))


class WheelLost(Kind):
    """One of a robot's two wheels stands still; the robot can only turn about it."""

    Settings = WheelLostSettings
    dynamics = "physics"


ROTOR_LOST = "rotor-lost"


class RotorLost(Kind):
    """A quadcopter's front right rotor gives no thrust any more; it tumbles."""

    dynamics = "jsbsim"


@dataclass(frozen=True)
class DriftSettings:
    angle_deg: float | None = key(
        None, "angle by which the body moves to the left of where it should [degrees]", low=-180, high=180
    )

    def problems(self) -> list[Problem]:
        return [Problem("angle_deg", "nothing", "must be given")] if self.angle_deg is None else []


class Drift(Kind):
    """The body pulls to one side: it moves at an angle to its command. Angles add up."""

    Settings = DriftSettings

    def __init__(self, name: str, scenario: Scenario, orders: Orders) -> None:
        super().__init__(name, scenario, orders)
        self._turns: list[tuple[list[int], Floats]] = []

    def look(self, faults: Sequence[ActiveFault]) -> None:
        super().look(faults)
        self._turns = []
        for fault in faults:
            cos, sin = (f(math.radians(fault.settings.angle_deg)) for f in (math.cos, math.sin))
            self._turns.append((sorted(fault.agents), np.array([[cos, sin], [-sin, cos]])))

    def drive(self, velocities_mps: Floats) -> None:
        for agents, turn in self._turns:
            velocities_mps[agents] = velocities_mps[agents] @ turn
