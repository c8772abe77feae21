"""Conversion between a robot's odometry frame and the arena's frame, both in m with angles counter-clockwise."""

import math
from typing import NamedTuple


class Pose(NamedTuple):
    """A position [m] and a heading [rad from +x towards +y]."""

    x_m: float
    y_m: float
    heading_rad: float


class PlanarFrame(NamedTuple):
    """The arena's corner (0, 0) [m; odometry frame], and the direction of its +x there [degrees]."""

    origin_x_m: float = 0.0
    origin_y_m: float = 0.0
    turn_deg: float = 0.0

    def to_arena(self, pose: Pose) -> Pose:
        """Convert a pose in the odometry frame to one in the arena."""
        turn_rad = math.radians(self.turn_deg)
        sine, cosine = math.sin(turn_rad), math.cos(turn_rad)
        x_m, y_m = pose.x_m - self.origin_x_m, pose.y_m - self.origin_y_m
        heading_rad = math.remainder(pose.heading_rad - turn_rad, math.tau)
        return Pose(cosine * x_m + sine * y_m, cosine * y_m - sine * x_m, heading_rad)


def beside(pose: Pose, forward_m: float, left_m: float) -> tuple[float, float]:
    """Return the position of a point that a robot at `pose` has ahead and to its left [m]."""
    sine, cosine = math.sin(pose.heading_rad), math.cos(pose.heading_rad)
    return pose.x_m + cosine * forward_m - sine * left_m, pose.y_m + sine * forward_m + cosine * left_m
