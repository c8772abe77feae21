"""A robot's own controller, between the velocity that its agent wants and its wheels. Pure.

Positions and velocities are complex numbers, x + iy [m; m/s; world frame], one per robot.

What a proximity sensor sees slows a robot down: it may approach a thing only as fast as it can still brake to a stop,
before half of the gap to another robot, which does the same, or before the gap to a wall. What it may not do towards
another robot it does to the right of it, so that two that meet pass each other on the left, as ships do.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from deltaswarm_physics.settings import BRAKES
from deltaswarm_world.core.arrays import Floats, Indices, Mask

Complex = npt.NDArray[np.complex128]

STANDOFF_OF_RADIUS = 0.1
"""Gap at which a robot approaches no further, as a share of its radius."""
PER_S = 2.0
"""Rate at which a robot corrects its distance from where it should be [1/s]."""
TURNS_PER_S = 4.0
"""Rate at which it corrects its heading [1/s]."""
REVERSES_BELOW = 0.3
"""Below this share of its speed a robot drives backwards rather than turn round."""


@dataclass(frozen=True)
class Motors:
    """What the motors of a robot can do; `base_m` is None for one that moves in any direction."""

    speed_mps: float
    acceleration_mps2: float
    turn_radps: float
    base_m: float | None


class Nearby:
    """What robots may come near in a step: pairs of robots, and pairs of a robot and a wall.

    Args:
        robots, others: the two robots of each pair, as indices.
        at_walls: the robot of each pair with a wall.
        from_m, along_m: where the wall begins, and the wall as a vector.
        radius_m: of a robot.
    """

    def __init__(
        self, robots: Indices, others: Indices, at_walls: Indices, from_m: Complex, along_m: Complex, radius_m: float
    ) -> None:
        self.others, self.first = others, robots
        self.at_walls, self.from_m, self.along_m = at_walls, from_m, along_m
        self.squares_m2 = _squares(along_m)
        self.robots = np.concatenate([robots, at_walls])
        is_robot = np.arange(len(self.robots)) < len(robots)
        self.reach_m: Floats = np.where(is_robot, 2.0 * radius_m, radius_m)
        self.standoff_m: Floats = self.reach_m + STANDOFF_OF_RADIUS * radius_m
        self.room: Floats = np.where(is_robot, 0.5, 1.0)
        """The share of a gap in which a robot stops."""
        self.aside: Complex = np.where(is_robot, -1.0 - 1j, -1.0)
        """What becomes of speed towards a thing: none is left, and before a robot it is turned to the right."""


class Gaps:
    """Directions and gaps from robots to what they see at a moment."""

    def __init__(self, nearby: Nearby, places_m: Complex, acceleration_mps2: float, cycle_s: float) -> None:
        offsets_m = places_m[nearby.others] - places_m[nearby.first]
        if len(nearby.at_walls):
            at_m = places_m[nearby.at_walls] - nearby.from_m
            part = (at_m * nearby.along_m.conj()).real / nearby.squares_m2
            to_wall_m = nearby.along_m * np.minimum(np.maximum(part, 0.0), 1.0) - at_m
            offsets_m = np.concatenate([offsets_m, to_wall_m])
        distances_m = np.maximum(np.abs(offsets_m), 1e-9)
        self.robots, self.aside = nearby.robots, nearby.aside
        self.gaps_m: Floats = distances_m - nearby.reach_m
        self.towards: Complex = offsets_m / distances_m
        brake_mps2 = BRAKES * acceleration_mps2
        room_m = nearby.room * np.maximum(distances_m - nearby.standoff_m, 0.0)
        lag_mps = brake_mps2 * cycle_s
        self.allowed_mps: Floats = np.sqrt(2.0 * brake_mps2 * room_m + lag_mps**2) - lag_mps
        """How fast each may be approached: for a cycle, and then braking, there is room."""


def closest_m(offsets_m: Complex, ways_m: Complex) -> Floats:
    """Return how near each offset comes to zero if it changes evenly by a way."""
    part = -(offsets_m * ways_m.conj()).real / np.maximum(_squares(ways_m), 1e-12)
    closest: Floats = np.abs(offsets_m + ways_m * np.minimum(np.maximum(part, 0.0), 1.0))
    return closest


def limited(wanted_mps: Complex, gaps: Gaps, sensor_m: float) -> tuple[Complex, Mask]:
    """Return the velocities that keep clear of what is nearby, and which robots they hold up."""
    robots, towards = gaps.robots, gaps.towards
    excess = (wanted_mps[robots] * towards.conj()).real - gaps.allowed_mps
    excess = np.where(gaps.gaps_m < sensor_m, np.maximum(excess, 0.0), 0.0)
    if not excess.any():
        return wanted_mps, np.zeros(len(wanted_mps), dtype=np.bool_)
    change = excess * towards * gaps.aside
    count = len(wanted_mps)
    real, imag = np.bincount(robots, change.real, count), np.bincount(robots, change.imag, count)
    return wanted_mps + real + 1j * imag, np.bincount(robots, excess, count) > 0.0


def capped(velocities_mps: Complex, most_mps: float) -> Complex:
    """Cut velocities to a speed, with their direction kept."""
    speeds = np.abs(velocities_mps)
    capped_mps: Complex = velocities_mps * (most_mps / np.maximum(speeds, most_mps))
    return capped_mps


def wheels_for(wanted_mps: Complex, headings: Complex, motors: Motors) -> tuple[Floats, Floats]:
    """Return speed ahead [m/s] and turning rate [rad/s] by which a robot with two wheels takes up a velocity."""
    assert motors.base_m is not None
    relative = wanted_mps * headings.conj()
    speeds = np.abs(relative)
    backs = (relative.real < 0.0) & (speeds < REVERSES_BELOW * motors.speed_mps)
    errors = np.angle(np.where(backs, -relative, relative))
    most = min(motors.turn_radps, 2.0 * motors.speed_mps / motors.base_m)
    turns = np.where(speeds > 1e-6, np.minimum(np.maximum(TURNS_PER_S * errors, -most), most), 0.0)
    ahead = np.where(backs, relative.real, np.maximum(relative.real, 0.0))
    room = motors.speed_mps - np.abs(turns) * (0.5 * motors.base_m)
    return np.minimum(np.maximum(ahead, -room), room), turns


def slowed(ahead_mps: Floats, headings: Complex, gaps: Gaps, sensor_m: float) -> Floats:
    """Return speeds along headings at which none approaches a thing too fast, whatever it turned aside for."""
    robots = gaps.robots
    closing = ahead_mps[robots] * (headings[robots] * gaps.towards.conj()).real
    is_fast = (closing > gaps.allowed_mps) & (gaps.gaps_m < sensor_m)
    if not is_fast.any():
        return ahead_mps
    factors = np.ones(len(ahead_mps))
    np.minimum.at(factors, robots[is_fast], gaps.allowed_mps[is_fast] / closing[is_fast])
    return ahead_mps * factors


def _squares(vectors: Complex) -> Floats:
    squares: Floats = vectors.real**2 + vectors.imag**2
    return squares
