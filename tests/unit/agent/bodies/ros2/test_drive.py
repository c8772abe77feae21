"""From a wanted velocity to a Twist, and what a robot makes of it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_ros2.motion import STOP, Drive

DIFFERENTIAL = Drive(is_holonomic=False, turn_gain=2.0, max_turn_radps=1.5)
HOLONOMIC = Drive(is_holonomic=True, turn_gain=2.0, max_turn_radps=1.5)

ANGLES = st.floats(-10.0, 10.0)
SPEEDS = st.floats(0.01, 5.0)


@pytest.mark.parametrize("drive", [DIFFERENTIAL, HOLONOMIC])
def test_a_velocity_of_zero_is_a_stop(drive: Drive) -> None:
    """Without a turn: zero has no direction."""
    assert drive.twist((0.0, 0.0), 1.0) == STOP


@pytest.mark.parametrize(
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
