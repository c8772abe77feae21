"""A robot's motion: its position by odometry, reasons to distrust that, and the Twist for a wanted velocity.

All times in s by the board's clock; angles are counter-clockwise, as in ROS (REP 103).
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from deltaswarm_board.bodies.guard import STAND, Velocity


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
        turn_rad = math.radians(self.turn_deg)
        sine, cosine = math.sin(turn_rad), math.cos(turn_rad)
        x_m, y_m = pose.x_m - self.origin_x_m, pose.y_m - self.origin_y_m
        heading_rad = math.remainder(pose.heading_rad - turn_rad, math.tau)
        return Pose(cosine * x_m + sine * y_m, cosine * y_m - sine * x_m, heading_rad)


def beside(pose: Pose, forward_m: float, left_m: float) -> tuple[float, float]:
    """Return the position of a point that a robot at `pose` has ahead and to its left [m]."""
    sine, cosine = math.sin(pose.heading_rad), math.cos(pose.heading_rad)
    return pose.x_m + cosine * forward_m - sine * left_m, pose.y_m + sine * forward_m + cosine * left_m


ROTATION_ERROR = 0.1
"""Largest deviation of a quaternion's length from 1."""

CLOCK_BACK_S = 1.0
"""Stamps that go back by more are of a publisher that restarted; by less, of samples in another order."""

TWO_STREAMS = "two streams of stamps or positions; leave one robot, then restart the agent"

RESTARTED = "its odometry restarted, and the frame may have moved: restart the agent"


TWIN_M, TWIN_SPEED = 0.3, 1.5
"""A robot is farther from its last position only by this [m] and by this many times what its speed limit allows."""

TWIN_SIGNS, TWIN_MESSAGES, TWIN_BACK = 5, 20, 4
"""Signs that show two robots, within this many messages; each position is compared with this many before it."""


class Streams:
    """Tells whether the messages of one topic are two robots', though they do not say who sent them.

    A sign is a stamp that is not later than the newest of the last few messages (two clocks), or a position that is
    farther from the last one than a robot drives in that time but not from an earlier one (two places). One clock that
    is set back shows fewer signs than two clocks. Two robots that are beside each other and whose stamps come in order
    show none.
    """

    def __init__(self, max_speed_mps: float) -> None:
        self.are_two = False
        """Whether two robots were seen; only a person knows which one is left."""
        self._speed_mps = TWIN_SPEED * max_speed_mps
        self._places: deque[tuple[float, float, float]] = deque(maxlen=TWIN_BACK)
        self._signs: deque[bool] = deque(maxlen=TWIN_MESSAGES)

    def take(self, stamp_s: float, x_m: float, y_m: float) -> None:
        if self._places and self._places[-1] == (stamp_s, x_m, y_m):
            return  # the same message by two ways
        far = [
            math.hypot(x_m - at[1], y_m - at[2]) > TWIN_M + self._speed_mps * max(0.0, stamp_s - at[0])
            for at in self._places
        ]
        alternates = bool(far) and far[-1] and not all(far)
        self._signs.append(any(stamp_s <= at[0] for at in self._places) or alternates)
        self._places.append((stamp_s, x_m, y_m))
        self.are_two = self.are_two or sum(self._signs) >= TWIN_SIGNS


@dataclass(frozen=True)
class ExpectedOdometry:
    topic: str
    frame_id: str
    """The frame of its poses; "" for any."""
    frame: PlanarFrame
    lost_s: float
    """A publisher that is silent for longer is gone."""
    survives_restart: bool
    """Whether the frame is the same after a restart of the publisher."""
    max_speed_mps: float = math.inf
    """How fast the robot is driven at most."""


class Odometry:
    """Turns the messages of a topic into poses in the arena.

    A message is an Odometry or a PoseStamped; `gid` is the id of its publisher, empty where there is none.
    """

    def __init__(self, expected: ExpectedOdometry) -> None:
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
        self._streams = Streams(expected.max_speed_mps)

    def reason_to_stand(self, now_s: float) -> str:
        """Why the robot must not move by this odometry, in a few words; "" if it may."""
        if self._has_restarted:
            return RESTARTED
        if now_s - self._rival_heard_s <= self._expected.lost_s:
            return f"two robots have its name: two publishers of {self._expected.topic}"
        if self._streams.are_two:
            return f"two robots have its name: {self._expected.topic} has {TWO_STREAMS}"
        return self._mistake

    def take(self, message: Mapping[str, Any], gid: bytes, now_s: float) -> bool:
        """Take a message; return whether it gives a new pose."""
        if not self._is_of_the_robot(gid, now_s):
            return False
        covariance = message["pose"].get("covariance", ())
        pose = message["pose"]["pose"] if covariance else message["pose"]
        stamp_s = _seconds(message["header"]["stamp"])
        self._streams.take(stamp_s or now_s, pose["position"]["x"], pose["position"]["y"])
        if not self._is_new(stamp_s):
            return False
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

    def _is_new(self, stamp_s: float) -> bool:
        """Whether a stamp is later than the last one; a publisher may send no stamps."""
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


def _seconds(stamp: Mapping[str, int]) -> float:
    return stamp["sec"] + stamp["nanosec"] * 1e-9


def _heading_rad(turn: Mapping[str, float]) -> float:
    """Return the yaw of a quaternion [rad]."""
    x, y, z, w = turn["x"], turn["y"], turn["z"], turn["w"]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


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
