"""The random walk, and travel to a target (Tree Growth). Velocities in m/s, positions in m, world frame.

"A custom random walk where agents move in a straight line for a uniformly distributed amount of time before turning
onto a new randomly chosen heading."
"""

import math
from random import Random

from deltaswarm_agent.controller import Velocity
from deltaswarm_agent.controllers.paper.finds import RANDOM, RETURNING
from deltaswarm_agent.controllers.paper.returning import FoundPlaces
from deltaswarm_agent.core.obstacles import ObstacleMap, Stride
from deltaswarm_wire.messages import MAX_POSES
from deltaswarm_wire.settings import AgentSettings

LEVY_MIN_S = 1.0
"""Shortest leg of a Levy walk."""


def leg_s(rng: Random, leg_max_s: float, exponent: float) -> float:
    """Draw the duration of a leg: uniform, or by a power law between `LEVY_MIN_S` and the maximum [s]."""
    if not exponent:
        return rng.uniform(0.0, leg_max_s)
    least_s, share = min(LEVY_MIN_S, leg_max_s), rng.random()
    if exponent == 1:
        return float(least_s * (leg_max_s / least_s) ** share)
    power = 1 - exponent
    return float((least_s**power + share * (leg_max_s**power - least_s**power)) ** (1 / power))


class Walk:
    """Straight legs, a uniform new heading, specular walls and obstacles.

    Some legs lead back to where events were `found` (`returning.py`), unless an obstacle is in the way. On a straight
    leg the velocity is the same to the bit in every step, so that an agent need not be asked for it.
    """

    def __init__(
        self,
        shared: AgentSettings,
        leg_max_s: float,
        rng: Random,
        found: FoundPlaces | None = None,
        leg_exponent: float = 0.0,
    ) -> None:
        self._rng = rng
        self._found = found
        self._speed_mps = shared.speed_mps
        self._step_s = shared.step_s
        self._leg_max_s = leg_max_s
        self._leg_exponent = leg_exponent
        self._radius_m = shared.radius_m
        self._size_m = (shared.width_m, shared.height_m)
        self._obstacles = ObstacleMap(shared)
        self.vx_mps = self.vy_mps = 0.0
        self.ends = -1
        """The step in which the next leg begins."""
        self.leg = RANDOM
        """The kind of the present leg."""

    def turn(self, now: int, x_m: float, y_m: float) -> None:
        goal = self._found.next_goal(now) if self._found is not None else None
        if goal is not None and not self._obstacles.first_crossing(x_m, y_m, goal[0] - x_m, goal[1] - y_m):
            self.leg = RETURNING
            heading = math.atan2(goal[1] - y_m, goal[0] - x_m)
            time_s = math.dist((x_m, y_m), goal) / self._speed_mps
        else:
            self.leg = RANDOM
            heading = self._rng.uniform(0.0, math.tau)
            time_s = leg_s(self._rng, self._leg_max_s, self._leg_exponent)
        self.vx_mps = self._speed_mps * math.cos(heading)
        self.vy_mps = self._speed_mps * math.sin(heading)
        self.ends = now + max(1, math.ceil(time_s / self._step_s))

    def velocity(self, now: int, x_m: float, y_m: float) -> Velocity:
        if now >= self.ends:
            self.turn(now, x_m, y_m)
        vx_mps, self.vx_mps = _reflect(x_m, self.vx_mps, self._step_s, self._size_m[0], self._radius_m)
        vy_mps, self.vy_mps = _reflect(y_m, self.vy_mps, self._step_s, self._size_m[1], self._radius_m)
        to_x_m, to_y_m = x_m + vx_mps * self._step_s, y_m + vy_mps * self._step_s
        if not self._obstacles:
            return vx_mps, vy_mps
        mirrored = self._obstacles.reflect(x_m, y_m, Stride(to_x_m, to_y_m, self.vx_mps, self.vy_mps))
        if mirrored is None:
            return vx_mps, vy_mps
        self.vx_mps, self.vy_mps = mirrored.dx_m, mirrored.dy_m
        return (mirrored.to_x_m - x_m) / self._step_s, (mirrored.to_y_m - y_m) / self._step_s

    def straight_until(self, now: int, x_m: float, y_m: float, velocity: Velocity) -> int:
        """The step until which this step's `velocity` holds: the end of the leg, or the stride that is reflected."""
        if velocity != (self.vx_mps, self.vy_mps):
            return now + 1
        dx_m, dy_m = self.vx_mps * self._step_s, self.vy_mps * self._step_s
        most = min(self.ends - now, MAX_POSES)
        return now + max(1, self._obstacles.free_strides(x_m, y_m, dx_m, dy_m, most))


def _reflect(at_m: float, v_mps: float, step_s: float, wall_m: float, radius_m: float) -> tuple[float, float]:
    """The velocity of a stride that may cross a wall, and that after it; from beyond a wall it leads back.

    A body turns where it touches the wall.
    """
    at_m, wall_m = at_m - radius_m, wall_m - 2.0 * radius_m
    to_m = at_m + v_mps * step_s
    if 0.0 <= to_m <= wall_m and 0.0 <= at_m <= wall_m:
        return v_mps, v_mps
    stride_m = abs(v_mps * step_s)
    if at_m < 0.0:
        to_m, after = min(at_m + stride_m, wall_m), abs(v_mps)
    elif at_m > wall_m:
        to_m, after = max(at_m - stride_m, 0.0), -abs(v_mps)
    elif to_m < 0.0:
        to_m, after = min(-to_m, wall_m), -v_mps
    else:
        to_m, after = max(2.0 * wall_m - to_m, 0.0), -v_mps
    return (to_m - at_m) / step_s, after


def towards(x_m: float, y_m: float, to_x_m: float, to_y_m: float, shared: AgentSettings) -> Velocity:
    """Move straight to a target and stop there."""
    dx, dy = to_x_m - x_m, to_y_m - y_m
    time_s = max(math.sqrt(dx * dx + dy * dy) / shared.speed_mps, shared.step_s)
    return dx / time_s, dy / time_s
