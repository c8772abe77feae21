"""Where a robot is by its odometry, and why that is not believed. All times in s by the board's clock."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from deltaswarm_ros2.planar_frame import PlanarFrame, Pose

ROTATION_ERROR = 0.1
"""Largest deviation of a quaternion's length from 1."""

CLOCK_BACK_S = 1.0
"""Stamps that go back by more are of a publisher that restarted; by less, of samples in another order."""

RESTARTED = "its odometry restarted, and the frame may have moved: restart the agent"


@dataclass(frozen=True)
class Expected:
    """What the odometry of a robot must be like."""

    topic: str
    frame_id: str
    """The frame of its poses; "" for any."""
    frame: PlanarFrame
    lost_s: float
    """A publisher that is silent for longer is gone."""
    survives_restart: bool
    """Whether the frame is the same after a restart of the publisher."""


class Odometry:
    """Turns the messages of a topic into poses in the arena.

    A message is an Odometry or a PoseStamped; `gid` is the id of its publisher, empty where there is none.
    """

    def __init__(self, expected: Expected) -> None:
        self.pose: Pose | None = None
        """The newest pose [arena frame]."""
        self.std_m: float | None = None
        """The standard deviation of the position along the worse axis [m], where the robot sends one."""
        self._expected = expected
        self._mistake = ""
        self._has_restarted = False
        self._gid: bytes | None = None
        self._heard_s = self._rival_heard_s = -math.inf
        self._stamp_s = 0.0

    def reason_to_stand(self, now_s: float) -> str:
        """Why the robot must not move by this odometry, in a few words; "" if it may."""
        if self._has_restarted:
            return RESTARTED
        if now_s - self._rival_heard_s <= self._expected.lost_s:
            return f"two robots have its name: two publishers of {self._expected.topic}"
        return self._mistake

    def take(self, message: Mapping[str, Any], gid: bytes, now_s: float) -> bool:
        """Take a message; return whether it gives a new pose."""
        if not self._is_of_the_robot(gid, now_s) or not self._is_new(message["header"]["stamp"]):
            return False
        covariance = message["pose"].get("covariance", ())
        pose = message["pose"]["pose"] if covariance else message["pose"]
        self._mistake = self._mistake_in(message["header"]["frame_id"], pose)
        if self._mistake:
            return False
        at, turn = pose["position"], pose["orientation"]
        self.pose = self._expected.frame.to_arena(Pose(at["x"], at["y"], _heading_rad(turn)))
        variance_m2 = max(covariance[0], covariance[7]) if covariance else 0.0
        self.std_m = math.sqrt(variance_m2) if 0.0 < variance_m2 < math.inf else None
        return True

    def _is_of_the_robot(self, gid: bytes, now_s: float) -> bool:
        """Whether its publisher is the robot's: another is not believed as long as the robot's own is heard."""
        if self._gid not in (None, gid):
            if now_s - self._heard_s <= self._expected.lost_s:
                self._rival_heard_s = now_s
                return False
            self._restart()
        self._gid, self._heard_s = gid, now_s
        return True

    def _is_new(self, stamp: Mapping[str, int]) -> bool:
        """Whether a stamp is later than the last one; a publisher may send no stamps."""
        stamp_s = stamp["sec"] + stamp["nanosec"] * 1e-9
        if stamp_s == 0.0:
            return True
        if self._stamp_s - stamp_s > CLOCK_BACK_S:
            self._restart()
        elif stamp_s <= self._stamp_s:
            return False
        self._stamp_s = stamp_s
        return True

    def _restart(self) -> None:
        self._stamp_s = 0.0
        self._has_restarted = not self._expected.survives_restart

    def _mistake_in(self, frame_id: str, pose: Mapping[str, Any]) -> str:
        expected = self._expected
        if expected.frame_id not in ("", frame_id):
            return f"{expected.topic} is in the frame {frame_id!r} and not {expected.frame_id!r}"
        if not all(map(math.isfinite, pose["position"].values())):
            return f"{expected.topic} has a position that is not a number"
        length = math.hypot(*pose["orientation"].values())
        if not abs(length - 1.0) <= ROTATION_ERROR:
            return f"{expected.topic} has an orientation that is no rotation: a quaternion of length {length:.3g}"
        return ""


def _heading_rad(turn: Mapping[str, float]) -> float:
    """Return the yaw of a quaternion [rad]."""
    x, y, z, w = turn["x"], turn["y"], turn["z"], turn["w"]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
