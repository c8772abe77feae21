"""Where a robot is by its odometry, what is not believed, and the Twist for a wanted velocity."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_board.bodies.guard import Obedience
from deltaswarm_ros2.cdr import decode, encode
from deltaswarm_ros2.definitions import ODOMETRY, POSE_STAMPED
from deltaswarm_ros2.motion import (
    RESTARTED,
    STOP,
    Drive,
    ExpectedOdometry,
    Odometry,
    PlanarFrame,
    Pose,
    Streams,
    beside,
)
from deltaswarm_ros2.settings import Ros2Settings
from tests.support.tiers import in_one_test

ONE, TWO = b"one", b"two"


def an_odometry(**changes: Any) -> Odometry:
    expected = {"topic": "/odom", "frame_id": "odom", "frame": PlanarFrame(), "lost_s": 1.0, "survives_restart": False}
    return Odometry(ExpectedOdometry(**{**expected, **changes}))


def a_message(at_s: float = 1.0, *, x_m: float = 1.0, frame_id: str = "odom", **pose: Any) -> dict[str, Any]:
    sec, nanosec = divmod(round(at_s * 1e9), 1_000_000_000)
    header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame_id}
    posed = {"position": {"x": x_m, "y": 2.0}, "orientation": {"w": 1.0}, **pose}
    covariance = [0.0] * 36
    covariance[0], covariance[7] = 0.04, 0.09
    return decode(ODOMETRY, encode(ODOMETRY, {"header": header, "pose": {"pose": posed, "covariance": covariance}}))


def test_an_odometry_gives_pose_and_uncertainty() -> None:
    odometry = an_odometry()
    assert odometry.take(a_message(orientation={"z": 1.0}), ONE, 0.0)
    assert odometry.pose == pytest.approx((1.0, 2.0, math.pi))
    assert odometry.std_m == pytest.approx(0.3)
    assert odometry.reason_to_stand(0.0) == ""


def test_a_pose_stamped_gives_a_pose_alone() -> None:
    message = {"header": {"frame_id": "odom"}, "pose": {"position": {"x": 3.0}, "orientation": {"w": 1.0}}}
    odometry = an_odometry()
    assert odometry.take(decode(POSE_STAMPED, encode(POSE_STAMPED, message)), ONE, 0.0)
    assert (odometry.pose, odometry.std_m) == (Pose(3.0, 0.0, 0.0), None)


@pytest.mark.parametrize("yaw_rad", [-3.0, -1.0, 0.0, 0.5, 3.1])
@pytest.mark.parametrize("pitch_rad", [0.0, 0.4])
def test_the_heading_is_the_yaw(yaw_rad: float, pitch_rad: float) -> None:
    half, tilt = yaw_rad / 2, pitch_rad / 2
    turn = {"x": -math.sin(half) * math.sin(tilt), "y": math.cos(half) * math.sin(tilt)}
    turn |= {"z": math.sin(half) * math.cos(tilt), "w": math.cos(half) * math.cos(tilt)}
    odometry = an_odometry()
    assert odometry.take(a_message(orientation=turn), ONE, 0.0)
    assert odometry.pose is not None
    assert odometry.pose.heading_rad == pytest.approx(yaw_rad)


@in_one_test(
    ("message", "reason"),
    [
        (a_message(frame_id="map"), "/odom is in the frame 'map' and not 'odom'"),
        (a_message(x_m=math.nan), "/odom has a position that is not a number"),
        (a_message(orientation={}), "/odom has an orientation that is no rotation: a quaternion of length 0"),
        (a_message(orientation={"w": math.nan}), "no rotation: a quaternion of length nan"),
    ],
)
def test_what_is_not_believed_is_a_reason_to_stand(message: dict[str, Any], reason: str) -> None:
    odometry = an_odometry()
    assert not odometry.take(message, ONE, 0.0)
    assert odometry.pose is None
    assert reason in odometry.reason_to_stand(0.0)
    assert odometry.take(a_message(1.1), ONE, 0.1)
    assert odometry.reason_to_stand(0.1) == ""


def test_any_frame_may_be_allowed() -> None:
    assert an_odometry(frame_id="").take(a_message(frame_id="robot7/odom"), ONE, 0.0)


def test_a_stamp_that_stands_still_gives_no_new_position() -> None:
    """As of a driver that repeats its last estimate; a publisher without stamps is believed."""
    odometry = an_odometry()
    assert [odometry.take(a_message(at_s), ONE, 0.0) for at_s in (1.0, 1.0, 0.9, 1.1)] == [True, False, False, True]
    assert [odometry.take(a_message(0.0), ONE, 0.0) for _ in range(2)] == [True, True]


@pytest.mark.parametrize(("survives", "reason"), [(False, RESTARTED), (True, "")])
@pytest.mark.parametrize(("gid", "at_s"), [(ONE, 1.0), (TWO, 10.0)])
def test_a_restart_is_forgiven_only_where_the_frame_survives_it(
    gid: bytes, at_s: float, survives: bool, reason: str
) -> None:
    """It shows by stamps that go back, as of a simulator that is reset, or by another publisher."""
    odometry = an_odometry(survives_restart=survives)
    odometry.take(a_message(9.0), ONE, 0.0)
    assert odometry.take(a_message(at_s), gid, 5.0)
    assert odometry.reason_to_stand(100.0) == reason


def test_a_second_publisher_is_not_believed_while_the_first_is_heard() -> None:
    odometry = an_odometry()
    odometry.take(a_message(1.0), ONE, 0.0)
    assert not odometry.take(a_message(1.1, x_m=9.0), TWO, 0.1)
    assert odometry.pose is not None
    assert odometry.pose.x_m == 1.0
    assert odometry.reason_to_stand(0.5) == "two robots have its name: two publishers of /odom"
    assert odometry.take(a_message(1.2), ONE, 1.2)
    assert odometry.reason_to_stand(1.2) == ""


@given(*[st.floats(-100.0, 100.0)] * 4, st.floats(-360.0, 360.0))
def test_the_arena_lies_in_the_frame_where_the_options_say(
    x_m: float, y_m: float, origin_x_m: float, origin_y_m: float, turn_deg: float
) -> None:
    """Walking x along the arena's first axis and y to the left of it, from its corner, leads to the pose."""
    frame = PlanarFrame(origin_x_m, origin_y_m, turn_deg)
    corner = Pose(origin_x_m, origin_y_m, math.radians(turn_deg))
    there = beside(corner, x_m, y_m)
    pose = frame.to_arena(Pose(*there, math.radians(turn_deg) + 0.5))
    assert pose == pytest.approx((x_m, y_m, 0.5), abs=1e-6)


DIFFERENTIAL = Drive(is_holonomic=False, turn_gain=2.0, max_turn_radps=1.5)
HOLONOMIC = Drive(is_holonomic=True, turn_gain=2.0, max_turn_radps=1.5)

ANGLES = st.floats(-10.0, 10.0)
SPEEDS = st.floats(0.01, 5.0)


@pytest.mark.parametrize("drive", [DIFFERENTIAL, HOLONOMIC])
def test_a_velocity_of_zero_is_a_stop(drive: Drive) -> None:
    """Without a turn: zero has no direction."""
    assert drive.twist((0.0, 0.0), 1.0) == STOP


@in_one_test(
    ("heading_deg", "twist"),
    [
        (0.0, (1.0, 0.0, 0.0)),
        (-30.0, (math.cos(math.radians(30.0)), 0.0, 2.0 * math.radians(30.0))),
        (90.0, (0.0, 0.0, -1.5)),
        (170.0, (0.0, 0.0, -1.5)),
        (-170.0, (0.0, 0.0, 1.5)),
    ],
)
def test_a_differential_robot_turns_to_the_velocity_and_drives_what_it_faces(
    heading_deg: float, twist: tuple[float, float, float]
) -> None:
    """For a velocity of 1 m/s along x, by the shorter way round, no faster than it may turn."""
    assert DIFFERENTIAL.twist((1.0, 0.0), math.radians(heading_deg)) == pytest.approx(twist, abs=1e-9)


@given(SPEEDS, ANGLES, ANGLES)
def test_a_holonomic_robot_moves_with_the_velocity_whatever_its_heading(
    speed_mps: float, direction_rad: float, heading_rad: float
) -> None:
    """Turned back into the frame of the velocity, the Twist is the velocity."""
    velocity = (speed_mps * math.cos(direction_rad), speed_mps * math.sin(direction_rad))
    forward_mps, left_mps, turn_radps = HOLONOMIC.twist(velocity, heading_rad)
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    moved = (cosine * forward_mps - sine * left_mps, sine * forward_mps + cosine * left_mps)
    assert moved == pytest.approx(velocity, abs=1e-9)
    assert turn_radps == 0.0


@pytest.mark.parametrize("turn_radps", [0.1, 0.3, 0.5, 1.5])
def test_a_robot_that_turns_slowly_is_not_disobedient(turn_radps: float) -> None:
    """It faces away, turns on the spot at first, and does all that it is told."""
    limits = Ros2Settings(max_turn_radps=turn_radps).limits(1.0)
    drive, guard = DIFFERENTIAL._replace(max_turn_radps=turn_radps), Obedience(limits)
    x_m, heading_rad = 50.0, math.pi - 0.01
    for now_s in (0.1 * tick for tick in range(round(30.0 * limits.follow_s))):
        guard.locate((x_m, 0.0), now_s)
        guard.send((1.0, 0.0), now_s)
        assert guard.reason_to_stand(now_s) == ""
        forward_mps, _, turn = drive.twist((1.0, 0.0), heading_rad)
        x_m, heading_rad = x_m + 0.1 * forward_mps * math.cos(heading_rad), heading_rad + 0.1 * turn


@given(SPEEDS, ANGLES, ANGLES)
def test_a_differential_robot_ends_in_the_wanted_direction(
    speed_mps: float, direction_rad: float, heading_rad: float
) -> None:
    """From any heading, in the time of half a turn at full rate and three time constants, at ten commands a second."""
    velocity = (speed_mps * math.cos(direction_rad), speed_mps * math.sin(direction_rad))
    within_s = math.pi / DIFFERENTIAL.max_turn_radps + 3.0 / DIFFERENTIAL.turn_gain
    for _ in range(round(within_s / 0.1)):
        twist = DIFFERENTIAL.twist(velocity, heading_rad)
        assert 0.0 <= twist.forward_mps <= speed_mps * (1.0 + 1e-9)
        heading_rad += 0.1 * twist.turn_radps
    assert abs(math.remainder(direction_rad - heading_rad, math.tau)) < 0.15
    assert DIFFERENTIAL.twist(velocity, heading_rad).forward_mps == pytest.approx(speed_mps, rel=0.02)


def streams(*messages: tuple[float, float]) -> bool:
    """Whether (stamp [s], x [m]) in the order of arrival are taken for two robots; the limit is 1 m/s."""
    watched = Streams(1.0)
    for stamp_s, x_m in messages:
        watched.take(stamp_s, x_m, 2.0)
    return watched.are_two


def driving(start_s: float, x_m: float, count: int = 40, every_s: float = 0.05, mps: float = 1.0) -> list[Any]:
    return [(start_s + n * every_s, x_m + mps * n * every_s) for n in range(count)]


TWINS = {
    "driving side by side": (driving(0.0, 0.0), driving(0.02, 1.0)),
    "standing": (driving(0.0, 0.0, mps=0.0), driving(0.001, 0.5, mps=0.0)),
    "at other rates": (driving(0.0, 0.0), driving(0.0, 9.0, count=10, every_s=0.2)),
    "with clocks that differ": (driving(0.0, 0.0), [(at_s - 0.3, x_m) for at_s, x_m in driving(0.02, 0.05)]),
    "with clocks an hour apart": (driving(0.0, 0.0), [(at_s + 3600.0, x_m) for at_s, x_m in driving(0.02, 0.0)]),
    "with one simulated clock": (driving(0.0, 0.0, mps=0.0), driving(0.0, 0.1, mps=0.0)),
}


@pytest.mark.parametrize("twins", TWINS.values(), ids=TWINS.keys())
def test_two_robots_that_do_not_say_who_they_are_are_told_apart(twins: tuple[list[Any], list[Any]]) -> None:
    """By their stamps or by their places; each of them alone is one robot."""
    arrived = {
        (n * every_s + late_s, late_s): message
        for late_s, every_s, stream in ((0.0, 0.05, twins[0]), (0.02, 2.0 / len(twins[1]), twins[1]))
        for n, message in enumerate(stream)
    }
    assert streams(*(arrived[at] for at in sorted(arrived)))
    assert not any(streams(*stream) for stream in twins)


ALONE = {
    "a jump": [*driving(0.0, 0.0), *driving(2.0, 20.0)],
    "noise": [(at_s, x_m + (0.1 if n % 2 else -0.1)) for n, (at_s, x_m) in enumerate(driving(0.0, 0.0))],
    "lost messages": driving(0.0, 0.0)[::5],
    "each twice": [message for message in driving(0.0, 0.0) for _ in range(2)],
    "three in another order": [driving(0.0, 0.0)[n + (n % 12 == 3) - (n % 12 == 4)] for n in range(36)],
    "a restart": [*driving(100.0, 5.0), *driving(0.0, 5.0)],
    "a clock that is set back": [*driving(100.0, 5.0), *driving(101.5, 7.0)],
    "half the limit faster": driving(0.0, 0.0, mps=1.5),
}


@pytest.mark.parametrize("messages", ALONE.values(), ids=ALONE.keys())
def test_one_robot_is_not_taken_for_two(messages: list[Any]) -> None:
    assert not streams(*messages)


def test_two_robots_stand_until_a_person_says_so() -> None:
    """Nobody knows which one is left when one goes."""
    odometry = an_odometry(max_speed_mps=1.0)
    for n in range(40):
        odometry.take(a_message(1.0 + n * 0.05, x_m=9.0 * (n % 2)), b"", 1.0 + n * 0.05)
    for n in range(400):
        odometry.take(a_message(3.0 + n * 0.05, x_m=0.0), b"", 3.0 + n * 0.05)
    assert "two robots have its name" in odometry.reason_to_stand(23.0)
