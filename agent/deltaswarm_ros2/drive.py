"""From a wanted velocity to a robot's Twist. Angles are counter-clockwise from +x, as in ROS (REP 103)."""

import math
from typing import NamedTuple

from deltaswarm_board.bodies.guard import STAND, Velocity


class Twist(NamedTuple):
    """Velocities in the robot's own frame: x forward and y left [m/s], turn counter-clockwise [rad/s]."""

    forward_mps: float
    left_mps: float
    turn_radps: float


STOP = Twist(0.0, 0.0, 0.0)


class Drive(NamedTuple):
    """How a robot follows a velocity.

    A holonomic robot takes any velocity and keeps its heading. A differential one turns towards the velocity, by
    `turn_gain` [1/s] times the angle that is left, and drives with the part of the velocity that it faces: away from
    it, it turns on the spot.
    """

    is_holonomic: bool
    turn_gain: float
    max_turn_radps: float

    def twist(self, velocity: Velocity, heading_rad: float) -> Twist:
        """Return the Twist for a velocity [m/s] of a robot with this heading, both in one frame."""
        if velocity == STAND:
            return STOP
        speed_mps = math.hypot(*velocity)
        left_rad = math.remainder(math.atan2(velocity[1], velocity[0]) - heading_rad, math.tau)
        along_mps = speed_mps * math.cos(left_rad)
        if self.is_holonomic:
            return Twist(along_mps, speed_mps * math.sin(left_rad), 0.0)
        turn_radps = max(-self.max_turn_radps, min(self.max_turn_radps, self.turn_gain * left_rad))
        return Twist(max(0.0, along_mps), 0.0, turn_radps)
