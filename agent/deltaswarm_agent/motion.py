"""Motion: the random walk and the way to a place. Velocities in m/s, places in m, world frame."""

import math
from random import Random

from deltaswarm_agent.obstacles import Obstacles, Stride
from deltaswarm_wire.settings import AgentSettings

Velocity = tuple[float, float]

STAND: Velocity = (0.0, 0.0)


class Walk:
    """Straight legs of uniform length in time, a uniform new heading, specular walls (Tree Growth)."""

    def __init__(self, settings: AgentSettings, rng: Random) -> None:
        self._rng = rng
        self._stride_m = settings.speed_mps * settings.step_s
        self._step_s = settings.step_s
        self._leg_max_s = settings.control.leg_max_s
        self._size_m = (settings.width_m, settings.height_m)
        self._obstacles = Obstacles(settings) if settings.obstacles else None
        self.turn()

    def turn(self) -> None:
        """Begin a new leg."""
        heading = self._rng.uniform(0.0, math.tau)
        self._dx = self._stride_m * math.cos(heading)
        self._dy = self._stride_m * math.sin(heading)
        self._left_s = self._rng.uniform(0.0, self._leg_max_s)

    def velocity(self, x_m: float, y_m: float) -> Velocity:
        """The velocity of this step, from where the agent is."""
        if self._left_s <= 0.0:
            self.turn()
        self._left_s -= self._step_s
        to_x, self._dx = _reflect(x_m, self._dx, self._size_m[0])
        to_y, self._dy = _reflect(y_m, self._dy, self._size_m[1])
        if self._obstacles is not None:
            reflected = self._obstacles.reflect(x_m, y_m, Stride(to_x, to_y, self._dx, self._dy))
            if reflected is not None:
                to_x, to_y, self._dx, self._dy = reflected
        return (to_x - x_m) / self._step_s, (to_y - y_m) / self._step_s


def _reflect(at_m: float, stride_m: float, wall_m: float) -> tuple[float, float]:
    """Where a stride that may cross a wall ends, and the stride after it; from beyond a wall it leads back."""
    if at_m < 0.0:
        return min(at_m + abs(stride_m), wall_m), abs(stride_m)
    if at_m > wall_m:
        return max(at_m - abs(stride_m), 0.0), -abs(stride_m)
    to_m = at_m + stride_m
    if to_m < 0.0:
        return min(-to_m, wall_m), -stride_m
    if to_m > wall_m:
        return max(2.0 * wall_m - to_m, 0.0), -stride_m
    return to_m, stride_m


def towards(x_m: float, y_m: float, to_x_m: float, to_y_m: float, settings: AgentSettings) -> Velocity:
    """Straight to a place, stopping on it."""
    dx, dy = to_x_m - x_m, to_y_m - y_m
    time_s = max(math.sqrt(dx * dx + dy * dy) / settings.speed_mps, settings.step_s)
    return dx / time_s, dy / time_s
