"""`world.dynamics = "physics"`: discs with motors, a proximity sensor and a controller of their own, that collide."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from deltaswarm_physics.engine import ANGLE, MASS_KG, MOMENT_OF_RADIUS, SLOP_OF_RADIUS, TURN, VX, Engine
from deltaswarm_physics.settings import CYCLE_S, DIFFERENTIAL, PROXIMITY, WHEEL_LOST, PhysicsSettings
from deltaswarm_physics.steering import (
    PER_S,
    TURNS_PER_S,
    Complex,
    Gaps,
    Motors,
    Nearby,
    capped,
    closest_m,
    limited,
    slowed,
    wheels_for,
)
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.arrays import Floats, Indices, Mask, generator, near
from deltaswarm_world.core.dynamics import NO_CRASHES, BodyState
from deltaswarm_world.core.faults.kind import ActiveFault
from deltaswarm_world.core.obstacles import Obstacles

HEADING_STREAM = 61
JAM_S = 60.0
"""A blocked robot is jammed if it has wanted to move for this long [s] and got no further than its diameter."""
TOUCH_OF_RADIUS = 1.5 * SLOP_OF_RADIUS
"""Gap at which bodies touch, as a share of the radius."""
STRAYS = 0.5
"""How far a robot may be off its straight way, in ways to brake twice."""


class Physics:
    Settings = PhysicsSettings
    crashes = NO_CRASHES

    def __init__(self, settings: PhysicsSettings, scenario: Scenario, obstacles: Obstacles) -> None:
        self.starts_m: Floats | None = np.array(settings.starts_m) if settings.starts_m else None
        self.bumped: frozenset[int] = frozenset()
        self.blocked: frozenset[int] = frozenset()
        self._settings = settings
        self._arena = scenario.arena
        self._step_s = scenario.run.step_s
        self._obstacles = obstacles
        speed_mps = scenario.agents.speed_mps
        self._sensor_m = settings.sensor_m(speed_mps)
        base_m = settings.base_m if settings.drive == DIFFERENTIAL else None
        self._motors = Motors(speed_mps, settings.acceleration_mps2, settings.turn_rate_radps, base_m)
        substeps = settings.substeps or settings.least_substeps(speed_mps, self._step_s)
        self._ticks = math.ceil(self._step_s / CYCLE_S - 1e-9)
        """Cycles of the robots' own controllers in a step."""
        self._tick_s = self._step_s / self._ticks
        self._substeps = -(-substeps // self._ticks)
        """Steps of the engine in a cycle."""
        edge = _loop(
            [
                (0.0, 0.0),
                (scenario.arena.width_m, 0.0),
                (scenario.arena.width_m, scenario.arena.height_m),
                (0.0, scenario.arena.height_m),
            ]
        )
        loops = [edge, *(_loop(obstacle.corners_m) for obstacle in scenario.arena.obstacles)]
        self._walls_m: Complex = np.concatenate([loop for loop, _ in loops])
        self._walls_along_m: Complex = np.concatenate([along for _, along in loops])
        count = scenario.agents.count
        self._states: Floats = np.zeros((count, 6))
        self._states[:, ANGLE] = generator(scenario.seed, HEADING_STREAM).uniform(-np.pi, np.pi, count)
        self._engine: Engine | None = None
        self._steps = 0
        self._blocked_steps = np.zeros(count, dtype=np.int64)
        self._bumped_steps = np.zeros(count, dtype=np.int64)
        self._jams = 0
        self._left_m: Complex = np.full(count, np.nan, dtype=np.complex128)
        """Where each robot was when it last had got on, or wanted nothing."""
        self._left_step = np.zeros(count, dtype=np.int64)
        self._is_jammed: Mask = np.zeros(count, dtype=np.bool_)

    def __getstate__(self) -> dict[str, Any]:
        """The engine is made again from the robots' states."""
        return self.__dict__ | {"_engine": None}

    # Where robots start

    def misplaced(self, places_m: Floats) -> Mask:
        """See `Dynamics`: a robot that stands in a wall or in another one of a lower number."""
        radius_m = self._settings.radius_m
        misplaced = self._obstacles.inside(places_m)
        robots, _ = self._near_walls(_complex(places_m), radius_m)
        misplaced[robots] = True
        first, second = near(places_m, places_m, 2.0 * radius_m)
        misplaced[first[second < first]] = True
        return misplaced

    # A step

    def move(self, positions_m: Floats, velocities_mps: Floats, faults: Sequence[ActiveFault]) -> Floats:
        if self._engine is None:
            self._states[:, :2] = positions_m
            settings, arena = self._settings, self._arena
            size_m = (arena.width_m, arena.height_m)
            self._engine = Engine(self._states, settings.radius_m, settings.friction, size_m, arena.obstacles)
        engine, tick_s, touch_m = self._engine, self._tick_s, TOUCH_OF_RADIUS * self._settings.radius_m
        commanded = _complex(velocities_mps)
        began_m = _complex(positions_m)
        nearby = self._nearby(positions_m, began_m, commanded)
        lost = _lost_wheels(faults)
        hindered: Mask = np.zeros(len(commanded), dtype=np.bool_)
        touching: Mask = np.zeros(len(commanded), dtype=np.bool_)
        for tick in range(self._ticks):
            states = engine.states()
            places_m = states[:, 0] + 1j * states[:, 1]
            wanted = commanded + PER_S * (began_m + commanded * (tick * tick_s) - places_m)
            gaps = None
            if len(nearby.robots):
                gaps = Gaps(nearby, places_m, self._motors.acceleration_mps2, tick_s)
                nearest_m = float(gaps.gaps_m.min())
                if nearest_m <= touch_m:
                    touching[gaps.robots[gaps.gaps_m <= touch_m]] = True
                if nearest_m >= self._sensor_m or self._settings.avoidance != PROXIMITY:
                    gaps = None
                else:
                    wanted, held = limited(wanted, gaps, self._sensor_m)
                    hindered |= held
            self._drive(engine, states, capped(wanted, self._motors.speed_mps), gaps, lost)
            for _ in range(self._substeps):
                engine.step(tick_s / self._substeps)
        self._states = engine.states().copy()
        if engine.has_contacts:
            self._engine = None
        self._note(began_m, commanded, hindered, touching)
        return self._states[:, :2].copy()

    def _drive(
        self, engine: Engine, states: Floats, wanted: Complex, gaps: Gaps | None, lost: Sequence[tuple[list[int], int]]
    ) -> None:
        """Set forces and torques so that each robot takes up a velocity within a tick, as far as its motors can."""
        motors, radius_m, tick_s = self._motors, self._settings.radius_m, self._tick_s
        headings = np.exp(1j * states[:, ANGLE])
        velocities = states[:, VX] + 1j * states[:, VX + 1]
        most = motors.acceleration_mps2
        if motors.base_m is None:
            if gaps is not None:
                speeds = np.abs(wanted)
                ways = wanted / np.maximum(speeds, 1e-9)
                wanted = ways * slowed(speeds, ways, gaps, self._sensor_m)
            errors = np.angle(wanted * headings.conj())
            turns = np.where(
                np.abs(wanted) > 1e-6, np.clip(TURNS_PER_S * errors, -motors.turn_radps, motors.turn_radps), 0
            )
            forces = capped((wanted - velocities) / tick_s, most)
            most_turn = most / radius_m
        else:
            ahead, turns = wheels_for(wanted, headings, motors)
            if gaps is not None:
                ahead = slowed(ahead, headings, gaps, self._sensor_m)
            for robots, side in lost:
                kept = ahead[robots] + side * turns[robots] * motors.base_m / 2
                ahead[robots], turns[robots] = kept / 2, side * kept / motors.base_m
            change = (ahead - velocities * headings.conj()) / tick_s
            grip = self._settings.grip_mps2
            along = np.minimum(np.maximum(change.real, -most), most)
            forces = (along + 1j * np.minimum(np.maximum(change.imag, -grip), grip)) * headings
            most_turn = 2.0 * most / motors.base_m
        spins = np.minimum(np.maximum((turns - states[:, TURN]) / tick_s, -most_turn), most_turn)
        drives = engine.drives
        drives[:, 0], drives[:, 1] = forces.real * MASS_KG, forces.imag * MASS_KG
        drives[:, 2] = spins * (MOMENT_OF_RADIUS * radius_m**2)

    def _nearby(self, positions_m: Floats, places_m: Complex, commanded: Complex) -> Nearby:
        """Return what robots may see or touch in this step, if none strays too far from where it is commanded to."""
        speed_mps, radius_m = self._motors.speed_mps, self._settings.radius_m
        within_m = radius_m + self._sensor_m + STRAYS * speed_mps**2 / self._motors.acceleration_mps2
        way_m = speed_mps * self._step_s
        robots, others = near(positions_m, positions_m, within_m + radius_m + 2.0 * way_m)
        offsets_m, closing = places_m[others] - places_m[robots], (commanded[others] - commanded[robots]) * self._step_s
        meets = (closest_m(offsets_m, closing) <= within_m + radius_m) & (robots != others)
        at_walls, walls = self._near_walls(places_m, within_m + way_m)
        if len(at_walls):
            ends_m = places_m[at_walls] + commanded[at_walls] * self._step_s
            comes = (
                np.minimum(self._off_m(places_m[at_walls], walls), self._off_m(ends_m, walls)) <= within_m + way_m / 2
            )
            at_walls, walls = at_walls[comes], walls[comes]
        along_m = self._walls_along_m[walls]
        return Nearby(robots[meets], others[meets], at_walls, self._walls_m[walls], along_m, radius_m)

    def _near_walls(self, places_m: Complex, within_m: float) -> tuple[Indices, Indices]:
        """Return the robots within a distance of a wall, and that wall, for each such pair."""
        robots, walls = (self._off_m(places_m[:, None], np.arange(len(self._walls_m))) < within_m).nonzero()
        return robots, walls

    def _off_m(self, places_m: Complex, walls: Indices) -> Floats:
        along_m = self._walls_along_m[walls]
        at_m = places_m - self._walls_m[walls]
        part = (at_m * along_m.conj()).real / (along_m.real**2 + along_m.imag**2)
        off_m: Floats = np.abs(at_m - along_m * np.minimum(np.maximum(part, 0.0), 1.0))
        return off_m

    # What robots feel, and what a run says of them

    def _note(self, began_m: Complex, commanded: Complex, hindered: Mask, touching: Mask) -> None:
        self._steps += 1
        places_m = self._states[:, 0] + 1j * self._states[:, 1]
        wanted_m = np.abs(commanded) * self._step_s
        progress_m = ((places_m - began_m) * commanded.conj()).real * self._step_s
        blocked = (hindered | touching) & (progress_m < 0.5 * wanted_m**2)
        self._blocked_steps += blocked
        self._bumped_steps += touching
        self.bumped = frozenset(touching.nonzero()[0].tolist())
        self.blocked = frozenset(blocked.nonzero()[0].tolist())
        got_on = ~(np.abs(places_m - self._left_m) <= 2.0 * self._settings.radius_m) | (wanted_m == 0.0)
        self._left_m = np.where(got_on, places_m, self._left_m)
        self._left_step = np.where(got_on, self._steps, self._left_step)
        is_jammed = blocked & ((self._steps - self._left_step) * self._step_s >= JAM_S)
        self._jams += int(np.count_nonzero(is_jammed & ~self._is_jammed))
        self._is_jammed = is_jammed | (self._is_jammed & ~got_on)

    def states(self) -> list[BodyState]:
        """See `Dynamics`; robots that move in any direction have no wheels, so their wheel speeds are 0."""
        states = self._states
        turns = states[:, TURN]
        ahead = states[:, VX] * np.cos(states[:, ANGLE]) + states[:, VX + 1] * np.sin(states[:, ANGLE])
        base_m = self._motors.base_m
        half = turns * (base_m or 0.0) / 2
        left, right = (ahead - half, ahead + half) if base_m else (0.0 * ahead, 0.0 * ahead)
        headings = np.angle(np.exp(1j * states[:, ANGLE]))
        return list(map(BodyState, headings.tolist(), left.tolist(), right.tolist()))

    @property
    def totals(self) -> dict[str, Any]:
        steps = max(1, self._steps)
        return {
            "blocked_share": float(self._blocked_steps.mean()) / steps,
            "bumped_share": float(self._bumped_steps.mean()) / steps,
            "jams": self._jams,
        }


def _complex(pairs: Floats) -> Complex:
    numbers: Complex = pairs[:, 0] + 1j * pairs[:, 1]
    return numbers


def _loop(corners: Sequence[Sequence[float]]) -> tuple[Complex, Complex]:
    begins = np.array([complex(x, y) for x, y in corners])
    return begins, np.roll(begins, -1) - begins


def _lost_wheels(faults: Sequence[ActiveFault]) -> list[tuple[list[int], int]]:
    """Return robots without a wheel, with the side of the wheel that is left: -1 left, 1 right."""
    return [
        (sorted(fault.agents), -1 if fault.settings.wheel == "right" else 1)
        for fault in faults
        if fault.fault.kind == WHEEL_LOST
    ]
