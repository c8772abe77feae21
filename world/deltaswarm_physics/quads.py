"""`world.dynamics = "jsbsim"`: every agent is a quadcopter that flies at a height of its own, in wind and gusts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from deltaswarm_physics.faults import ROTOR_LOST
from deltaswarm_physics.quadcopter import CYCLE_S, GROUND_M, Quadcopter
from deltaswarm_physics.steering import PER_S, Complex, capped
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, key
from deltaswarm_world.core.arrays import Floats, Mask, generator, near
from deltaswarm_world.core.dynamics import BodyState
from deltaswarm_world.core.faults.kind import ActiveFault
from deltaswarm_world.core.obstacles import Obstacles

GUST_STREAM = 62
VERTICAL = 0.5
"""Gusts up and down, as a share of those along x and y."""
AHEAD_S = 1.0
"""A quadcopter slows down for a wall that it would reach within this time."""
MOST_SPEED_MPS = 3.0
"""Faster ones do not settle: an act asks them to be at their goal after one step, in which they cannot stop."""
LEAST_HEIGHT_M = 0.3


@dataclass(frozen=True)
class QuadSettings:
    """Quadcopters, and the wind that they fly in."""

    radius_m: float = key(
        0.35, "distance that a quadcopter keeps from walls: its radius with propellers [m]", low=0.1, high=100
    )
    heights_m: tuple[float, ...] = key(
        (10.0,), "heights above the ground at which agents fly, by turns: one for all, or one for each [m]", length=None
    )
    wind_mps: float = key(0.0, "speed of the steady wind [m/s]", low=0, high=15)
    wind_from_deg: float = key(
        270.0, "where it blows from, clockwise from north, which is y [degrees]", low=0, high=360
    )
    gust_mps: float = key(
        0.0, "standard deviation of gusts along x and along y; half of it up and down [m/s]", low=0, high=5
    )
    gust_s: float = key(2.0, "time in which a gust fades to 1/e [s]", low=0.1, high=1000)

    def problems_with(self, scenario: Scenario) -> list[Problem]:
        problems, arena = [], scenario.arena
        if scenario.agents.speed_mps > MOST_SPEED_MPS:
            problems.append(
                Problem(
                    "dynamics",
                    f"agents.speed_mps = {scenario.agents.speed_mps:g}",
                    f"must have agents.speed_mps of at most {MOST_SPEED_MPS:g} m/s with quadcopters",
                )
            )
        if 2 * self.radius_m >= min(arena.width_m, arena.height_m):
            problems.append(
                Problem("radius_m", f"{self.radius_m:g}", "must be less than half of the arena's shorter side")
            )
        if not self.heights_m:
            problems.append(Problem("heights_m", "none", "must have at least one height"))
        for index, height_m in enumerate(self.heights_m):
            if not LEAST_HEIGHT_M <= height_m <= 1000.0:
                problems.append(
                    Problem(f"heights_m[{index}]", f"{height_m:g}", f"must be from {LEAST_HEIGHT_M:g} to 1000 m")
                )
        return problems


class Quads:
    Settings = QuadSettings
    UNSAVED = "JSBSim does not give out all of an aircraft's state"
    """Why its bodies cannot be part of a checkpoint."""
    to_process = True
    starts_m: Floats | None = None

    def __init__(self, settings: QuadSettings, scenario: Scenario, obstacles: Obstacles) -> None:
        self.bumped: frozenset[int] = frozenset()
        self.blocked: frozenset[int] = frozenset()
        self._settings = settings
        self._obstacles = obstacles
        self._speed_mps = scenario.agents.speed_mps
        self._cycles = math.ceil(scenario.run.step_s / CYCLE_S - 1e-9)
        self._cycle_s = scenario.run.step_s / self._cycles
        self._size_m = np.array([scenario.arena.width_m, scenario.arena.height_m])
        count, heights_m = scenario.agents.count, settings.heights_m
        self._heights_m = [heights_m[agent % len(heights_m)] for agent in range(count)]
        self._quads: list[Quadcopter] = []
        self._gusts = _Gusts(settings, generator(scenario.seed, GUST_STREAM), self._cycle_s)
        self._steps = self._blocked_steps = self._bumped_steps = 0

    def __reduce__(self) -> NoReturn:
        raise TypeError(f'world.dynamics = "jsbsim" cannot be saved: {self.UNSAVED}')

    def misplaced(self, places_m: Floats) -> Mask:
        """See `Dynamics`: a quadcopter that starts in an obstacle, or closer to the edge than it keeps."""
        near_edge = np.abs(places_m - self._size_m / 2) > self._size_m / 2 - self._settings.radius_m
        return self._obstacles.inside(places_m) | near_edge.any(axis=1)

    def move(self, positions_m: Floats, velocities_mps: Floats, faults: Sequence[ActiveFault]) -> Floats:
        if not self._quads:
            starts = zip(_complex(positions_m).tolist(), self._heights_m, strict=True)
            self._quads = [Quadcopter(start_m, height_m, self._cycle_s) for start_m, height_m in starts]
        lost = {agent for fault in faults if fault.fault.kind == ROTOR_LOST for agent in fault.agents}
        commanded, began_m = _complex(velocities_mps), _complex(positions_m)
        hindered: Mask = np.zeros(len(commanded), dtype=np.bool_)
        for cycle, winds_mps in enumerate(self._gusts.winds_mps(len(commanded), self._cycles)):
            places_m = np.array([quad.place_m for quad in self._quads])
            wanted = commanded + PER_S * (began_m + commanded * (cycle * self._cycle_s) - places_m)
            wanted = capped(wanted, self._speed_mps)
            free = (self._stopped(places_m, places_m + wanted * AHEAD_S) - places_m) / AHEAD_S
            hindered |= np.abs(free - wanted) > 1e-9
            for agent, (quad, velocity_mps, wind_mps) in enumerate(
                zip(self._quads, free.tolist(), winds_mps, strict=True)
            ):
                if not quad.crash:
                    quad.fly(velocity_mps, wind_mps, agent in lost)
        places_m = self._landed(np.array([quad.place_m for quad in self._quads]))
        self._note(began_m, places_m, commanded, hindered)
        return _pairs(places_m)

    def _stopped(self, places_m: Complex, ends_m: Complex) -> Complex:
        """Return where those end that move straight to somewhere, but keep clear of the edge and stop at obstacles."""
        radius_m = self._settings.radius_m
        kept_m = np.clip(_pairs(ends_m), radius_m, self._size_m - radius_m)
        return _complex(self._obstacles.stop(_pairs(places_m), kept_m) if self._obstacles else kept_m)

    def _landed(self, places_m: Complex) -> Complex:
        """Note who flew into a wall; return the places, none of which is beyond the edge."""
        pairs_m = _pairs(places_m)
        kept_m = np.clip(pairs_m, 0.0, self._size_m)
        beyond, inside = (kept_m != pairs_m).any(axis=1), self._obstacles.inside(kept_m)
        for quad, is_beyond, is_inside in zip(self._quads, beyond, inside, strict=True):
            if not quad.crash and (is_beyond or is_inside):
                quad.crash = f"flew into {'the edge of the arena' if is_beyond else 'an obstacle'}"
        return _complex(kept_m)

    def _note(self, began_m: Complex, places_m: Complex, commanded: Complex, hindered: Mask) -> None:
        wanted_m = np.abs(commanded) * self._cycle_s * self._cycles
        progress_m = ((places_m - began_m) * commanded.conj()).real * self._cycle_s * self._cycles
        self.blocked = frozenset((hindered & (progress_m < 0.5 * wanted_m**2)).nonzero()[0].tolist())
        pairs_m, reach_m = _pairs(places_m), 2.0 * self._settings.radius_m
        heights_m = np.array([math.nan if quad.crash else quad.height_m for quad in self._quads])
        first, second = near(pairs_m, pairs_m, reach_m)
        meet = (first != second) & (np.abs(heights_m[first] - heights_m[second]) < reach_m)
        self.bumped = frozenset(first[meet].tolist())
        self._steps += 1
        self._blocked_steps += len(self.blocked)
        self._bumped_steps += len(self.bumped)

    @property
    def crashes(self) -> Mapping[int, str]:
        """How quadcopters crashed, by agent."""
        return {agent: f"crashed: {quad.crash}" for agent, quad in enumerate(self._quads) if quad.crash}

    def states(self) -> list[BodyState]:
        """See `Dynamics`; before the first step all hover."""
        if not self._quads:
            return [BodyState(math.pi / 2, 0.0, 0.0, height_m, 0.0, 0.0) for height_m in self._heights_m]
        return [
            BodyState(
                math.remainder(math.pi / 2 - quad.yaw_rad, math.tau),
                *(0.0, 0.0),
                *(GROUND_M if quad.crash else quad.height_m, quad.roll_rad, quad.pitch_rad),
            )
            for quad in self._quads
        ]

    @property
    def totals(self) -> dict[str, Any]:
        agent_steps = max(1, self._steps * len(self._heights_m))
        return {
            "blocked_share": self._blocked_steps / agent_steps,
            "bumped_share": self._bumped_steps / agent_steps,
        }


class _Gusts:
    """The air's velocity at each quadcopter: a steady wind, and gusts with an exponential autocorrelation."""

    def __init__(self, settings: QuadSettings, rng: np.random.Generator, cycle_s: float) -> None:
        to_rad = math.radians(90.0 - settings.wind_from_deg + 180.0)
        self._steady_mps = np.array([math.cos(to_rad), math.sin(to_rad), 0.0]) * settings.wind_mps
        self._kept = math.exp(-cycle_s / settings.gust_s)
        self._drawn_mps = np.array([1.0, 1.0, VERTICAL]) * settings.gust_mps * math.sqrt(1.0 - self._kept**2)
        self._rng = rng
        self._gusts_mps: Any = 0.0

    def winds_mps(self, count: int, cycles: int) -> list[list[Any]]:
        """Return the wind along x, y and down at each quadcopter in each cycle."""
        if not self._drawn_mps.any():
            return [[tuple(self._steady_mps.tolist())] * count] * cycles
        winds = []
        for drawn in self._rng.standard_normal((cycles, count, 3)) * self._drawn_mps:
            self._gusts_mps = self._kept * self._gusts_mps + drawn
            winds.append((self._steady_mps + self._gusts_mps).tolist())
        return winds


def _complex(pairs: Floats) -> Complex:
    numbers: Complex = pairs[:, 0] + 1j * pairs[:, 1]
    return numbers


def _pairs(numbers: Complex) -> Floats:
    return np.column_stack([numbers.real, numbers.imag])
