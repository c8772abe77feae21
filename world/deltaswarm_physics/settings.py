"""The options of `world.dynamics = "physics"`, and what must hold of them before a run."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from deltaswarm_scenario.density import free_share
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, key
from deltaswarm_wire.obstacles import edge_distance_m2, is_inside

DIFFERENTIAL, HOLONOMIC = "differential", "holonomic"
WHEEL_LOST = "wheel-lost"
PROXIMITY, NONE = "proximity", "none"

CYCLE_S = 0.2
"""Longest cycle of a robot's own controller."""
BRAKES = 0.8
"""Share of the acceleration that a robot plans to brake with."""
MAX_SUBSTEP_S = 0.05
"""Longest step of the engine."""
SHARE_OF_RADIUS = 0.25
"""A body moves at most this share of its radius in a step of the engine, so that it passes nobody and no wall."""
MAX_SUBSTEPS = 10_000
WITH_TREES = "hierarchical", "hybrid", "adaptive"
"""Modes whose members keep 6 m apart, if `d_min_m` is not given."""

MAX_FILL = 0.4
"""Largest share of the arena that the bodies may cover: of more, random starting positions leave no room."""
MAX_FILL_OF_FREE = 0.6
"""The same of what obstacles leave free. Discs placed at random jam at 0.55 of a wide area, at 0.59 of a corridor."""


@dataclass(frozen=True)
class PhysicsSettings:
    """A robot: a disc with a motor, sensors, and a controller of its own between the agent's act and the wheels."""

    radius_m: float = key(0.25, "radius of a robot [m]", low=0.01, high=100)
    drive: str = key(DIFFERENTIAL, "two wheels, or motion in any direction", choices=(DIFFERENTIAL, HOLONOMIC))
    wheel_base_m: float | None = key(None, "distance between the wheels; default: 1.6 radii [m]", above=0, high=100)
    acceleration_mps2: float = key(2.0, "greatest acceleration and braking of a wheel [m/s2]", low=0.01, high=100)
    turn_rate_radps: float = key(3.0, "greatest turning rate [rad/s]", above=0, high=100)
    grip_mps2: float = key(
        7.0, "greatest acceleration by which wheels resist being pushed sideways [m/s2]", low=0, high=1000
    )
    friction: float = key(0.7, "friction of bodies against each other and walls", low=0, high=10)
    avoidance: str = key(
        PROXIMITY,
        "proximity: a robot slows down and turns aside before what its proximity sensor sees; none: it does not",
        choices=(PROXIMITY, NONE),
    )
    sensor_range_m: float | None = key(
        None, "range of the proximity sensor from the body's edge; default: twice the way to stop [m]", low=0, high=100
    )
    substeps: int = key(
        0,
        "steps of the engine in a step; 0: as few as a robot needs not to pass others or walls",
        low=0,
        high=MAX_SUBSTEPS,
    )
    starts_m: tuple[tuple[float, ...], ...] = key(
        (), "position of each robot at the start [m]; default: random", length=None
    )

    @property
    def base_m(self) -> float:
        return 1.6 * self.radius_m if self.wheel_base_m is None else self.wheel_base_m

    def sensor_m(self, speed_mps: float) -> float:
        to_stop_m = speed_mps * CYCLE_S + speed_mps**2 / (2.0 * BRAKES * self.acceleration_mps2)
        return 2.0 * to_stop_m if self.sensor_range_m is None else self.sensor_range_m

    def least_substeps(self, speed_mps: float, step_s: float) -> int:
        """Return the least number of the engine's steps in which no robot passes another one or a wall."""
        longest_s = min(MAX_SUBSTEP_S, SHARE_OF_RADIUS * self.radius_m / speed_mps)
        return math.ceil(step_s / longest_s - 1e-9)

    def problems_with(self, scenario: Scenario) -> list[Problem]:
        return list(self._problems_with(scenario))

    def _problems_with(self, scenario: Scenario) -> Iterator[Problem]:
        radius_m, count, arena = self.radius_m, scenario.agents.count, scenario.arena
        speed_mps, step_s = scenario.agents.speed_mps, scenario.run.step_s
        least = self.least_substeps(speed_mps, step_s)
        if least > MAX_SUBSTEPS:
            allowed = f"must be at most {MAX_SUBSTEPS} steps of the engine in a step; take a shorter run.step_s"
            yield Problem("substeps", f"{least} at {speed_mps:g} m/s with a radius of {radius_m:g} m", allowed)
        if 0 < self.substeps < least:
            allowed = (
                f"must be at least {least}: a step of the engine may last {MAX_SUBSTEP_S:g} s, and move "
                f"a robot at {speed_mps:g} m/s by a quarter of its radius of {radius_m:g} m"
            )
            yield Problem("substeps", f"{self.substeps}", allowed)
        mode = scenario.control.mode
        least_m = scenario.control.options.get("d_min_m", 6.0 if mode in WITH_TREES else None)
        spacing_m = None if mode == "decentralised" else least_m
        if isinstance(spacing_m, int | float) and 2 * radius_m > spacing_m:
            allowed = f"must be at most half of the least distance between members of a tree, {spacing_m / 2:g} m"
            yield Problem("radius_m", f"{radius_m:g}", allowed)
        size_m = arena.width_m, arena.height_m
        fill, free = count * math.pi * radius_m**2 / math.prod(size_m), free_share(size_m, arena.obstacles)
        if 2 * radius_m > min(size_m) or (2 * radius_m == min(size_m) and not self.starts_m):
            allowed = "must be less than half of the arena's shorter side; exactly half needs world.starts_m"
            yield Problem("radius_m", f"{radius_m:g}", allowed)
        elif not self.starts_m and fill > (most := min(MAX_FILL, MAX_FILL_OF_FREE * free)):
            obstacles = " with these obstacles" if arena.obstacles else ""
            allowed = f"must leave room: {count} robots may cover at most {most:.1%} of the arena{obstacles}"
            yield Problem("radius_m", f"{radius_m:g}, which covers {fill:.1%}", allowed)
        if self.drive == HOLONOMIC and any(fault.kind == WHEEL_LOST for fault in scenario.fault):
            yield Problem("drive", repr(HOLONOMIC), f"must be {DIFFERENTIAL} with the fault {WHEEL_LOST}")
        if self.base_m > 2 * radius_m:
            yield Problem("wheel_base_m", f"{self.base_m:g}", f"must be at most the diameter, {2 * radius_m:g} m")
        yield from self._problems_of_starts(scenario)

    def _problems_of_starts(self, scenario: Scenario) -> Iterator[Problem]:
        starts, arena, radius_m = self.starts_m, scenario.arena, self.radius_m
        if not starts:
            return
        if len(starts) != scenario.agents.count:
            yield Problem("starts_m", f"{len(starts)}", f"must be one position per agent, {scenario.agents.count}")
        if wrong := [index for index, place in enumerate(starts) if len(place) != 2]:
            yield Problem(f"starts_m[{wrong[0]}]", str(list(starts[wrong[0]])), "must be two coordinates [x, y]")
            return
        for index, (x_m, y_m) in enumerate(starts):
            given = f"[{x_m:g}, {y_m:g}]"
            if min(x_m, y_m, arena.width_m - x_m, arena.height_m - y_m) < radius_m:
                yield Problem(f"starts_m[{index}]", given, f"must be at least a radius, {radius_m:g} m, from the edge")
            for number, obstacle in enumerate(arena.obstacles):
                if is_inside((x_m, y_m), obstacle.corners_m) or _gap_m((x_m, y_m), obstacle.corners_m) < radius_m:
                    allowed = f"must be at least a radius, {radius_m:g} m, outside arena.obstacles[{number}]"
                    yield Problem(f"starts_m[{index}]", given, allowed)
        for (first, a), (second, b) in combinations(enumerate(starts), 2):
            if math.dist(a, b) < 2 * radius_m:
                allowed = f"must be at least two radii, {2 * radius_m:g} m, from starts_m[{first}]"
                yield Problem(f"starts_m[{second}]", f"{math.dist(a, b):g} m", allowed)


def _gap_m(place: tuple[float, float], corners: tuple[tuple[float, ...], ...]) -> float:
    edges = zip(corners, [*corners[1:], corners[0]], strict=True)
    return math.sqrt(min(edge_distance_m2(place, a, b) for a, b in edges))
