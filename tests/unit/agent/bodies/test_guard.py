"""What stands between an agent and a real vehicle: fence, frame, limits and watchdog, without any vehicle."""

import dataclasses
import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from deltaswarm_board.bodies.fence import Fence, Place
from deltaswarm_board.bodies.guard import STAND, Guard, GuardLimits
from deltaswarm_board.bodies.mavlink import LocalFrame
from deltaswarm_board.bodies.mavlink_settings import MavlinkSettings
from deltaswarm_wire.checked import SettingsError, load
from tests.support.tiers import in_one_test

SQUARE = Fence([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
HORSESHOE = Fence([(0, 0), (10, 0), (10, 10), (7, 10), (7, 3), (3, 3), (3, 10), (0, 10)])
"""Two arms, and nothing between them."""

LIMITS = GuardLimits(
    max_speed_mps=2.0, command_s=1.5, ahead_s=1.0, position_s=1.0, heartbeat_s=3.0, needs_armed=True, modes=("GUIDED",)
)

places = st.tuples(st.floats(-15, 25), st.floats(-15, 25))
speeds = st.tuples(st.floats(-5, 5), st.floats(-5, 5))
within, slow = st.tuples(st.floats(0.1, 9.9), st.floats(0.1, 2.9)), st.tuples(st.floats(-2, 2), st.floats(-2, 2))
"""Places within either fence, and velocities that are often permitted there."""


@given(within, slow, st.sampled_from([SQUARE, HORSESHOE]))
def test_nothing_permitted_leads_out(at: Place, velocity: Place, fence: Fence) -> None:
    assume(fence.permits(at, *velocity, 2.0))
    for tenth in range(11):
        share = 2.0 * tenth / 10
        assert fence.holds((at[0] + velocity[0] * share, at[1] + velocity[1] * share))


@given(st.lists(speeds, min_size=1, max_size=40), st.floats(0.1, 1))
def test_a_vehicle_that_obeys_stays_within(wishes: list[Place], step_s: float) -> None:
    """Whatever the agent wants, when the look ahead is at least a step."""
    guard = Guard(LIMITS, HORSESHOE, 0.1)
    at, now_s = (1.0, 1.0), 0.0
    for wish in wishes:
        guard.locate(*at, now_s)
        guard.command(*wish, now_s)
        velocity = guard.velocity(now_s)
        assert math.hypot(*velocity) <= 2.0 + 1e-9
        at = (at[0] + velocity[0] * step_s, at[1] + velocity[1] * step_s)
        now_s += step_s
        assert HORSESHOE.holds(at)


def test_no_way_leads_across_a_gap() -> None:
    """From one arm of the horseshoe to the other, though both are within."""
    assert HORSESHOE.holds((1.0, 8.0))
    assert HORSESHOE.holds((9.0, 8.0))
    assert not HORSESHOE.permits((1.0, 8.0), 8.0, 0.0, 1.0)


@given(places, speeds)
def test_from_outside_only_the_way_back_is_permitted(at: Place, velocity: Place) -> None:
    assume(not SQUARE.holds(at) and min(abs(at[0]), abs(at[0] - 10), abs(at[1]), abs(at[1] - 10)) > 0.01)

    def beyond_m(place: Place) -> float:
        return math.hypot(max(-place[0], 0, place[0] - 10), max(-place[1], 0, place[1] - 10))

    to = (at[0] + velocity[0], at[1] + velocity[1])
    assert SQUARE.permits(at, 0.0, 0.0, 1.0)
    if SQUARE.permits(at, *velocity, 1.0) and velocity != STAND:
        assert beyond_m(to) < beyond_m(at) + 1e-9


@in_one_test(
    ("corners", "message"),
    [
        ([(0, 0), (1, 1)], "3 corners.* 2"),
        ([(0, 0), (1, 1), (2, 2)], r"\(0, 0\)-\(1, 1\) and \(2, 2\)-\(0, 0\)"),
        ([(0, 0), (100, 100), (100, 0), (0, 80)], r"\(0, 0\)-\(100, 100\) and \(100, 0\)-\(0, 80\)"),
        ([(0, 0), (9, 0), (9, 9), (5, 0), (0, 9)], r"\(0, 0\)-\(9, 0\) and \(9, 9\)-\(5, 0\)"),
        ([(0, 0), (9, 0), (4, 0), (4, 9)], r"\(0, 0\)-\(9, 0\) and \(9, 0\)-\(4, 0\)"),
        ([(0, 0), (9, 0), (9, 9), (0, 0), (-9, 0)], r"corner once.*\(0, 0\)"),
        ([(0, 0), (9, 0), (9, 9), (0, 0)], r"corner once.*\(0, 0\)"),
        ([(0, 0), (9, 0), (9, 9), (9, 9)], r"corner once.*\(9, 9\)"),
    ],
)
def test_a_fence_that_is_no_simple_polygon_is_refused(corners: list[Place], message: str) -> None:
    """What is within it would be a matter of opinion; the edges or the corner are named."""
    with pytest.raises(ValueError, match=message):
        Fence(corners)
    with pytest.raises(SettingsError, match=f"^fence_m must .*{message}"):
        load(MavlinkSettings, {"fence_m": [list(corner) for corner in corners]})


@given(st.lists(st.tuples(st.floats(0, 6), st.floats(1, 9)), min_size=4, max_size=9, unique_by=lambda spoke: spoke[0]))
def test_a_fence_whose_corners_are_seen_in_order_from_within_is_allowed(spokes: list[Place]) -> None:
    """However far they are: no simple polygon is refused for its shape."""
    spokes.sort()
    turns = [angle for angle, _ in spokes]
    gaps = [later - earlier for earlier, later in pairwise([*turns, turns[0] + math.tau])]
    assume(min(gaps) > 0.1 and max(gaps) < 3.0)
    corners = [(far_m * math.cos(angle), far_m * math.sin(angle)) for angle, far_m in spokes]
    assert Fence(corners).holds((0.0, 0.0))


@given(st.floats(-100, 100), st.floats(-100, 100), st.floats(-360, 360), st.floats(-100, 100), st.floats(-100, 100))
def test_frames_turn_forth_and_back(north_m: float, east_m: float, heading_deg: float, x: float, y: float) -> None:
    frame = LocalFrame(north_m, east_m, heading_deg)
    north, east = frame.turned_to_ned(x, y)
    assert math.hypot(north, east) == pytest.approx(math.hypot(x, y))
    assert frame.turned_to_arena(north, east) == pytest.approx((x, y), abs=1e-9)
    assert frame.to_arena(north_m + north, east_m + east) == pytest.approx((x, y), abs=1e-9)


@in_one_test(
    ("heading_deg", "north", "east"), [(0.0, 1.0, 0.0), (90.0, 0.0, 1.0), (180.0, -1.0, 0.0), (-90.0, 0.0, -1.0)]
)
def test_the_heading_is_the_compass_direction_of_y(heading_deg: float, north: float, east: float) -> None:
    assert LocalFrame(0.0, 0.0, heading_deg).turned_to_ned(0.0, 1.0) == pytest.approx((north, east))


def a_guard(now_s: float = 0.0) -> Guard:
    """One whose vehicle is well, in the middle of the square."""
    guard = Guard(LIMITS, SQUARE, 0.1)
    guard.beat(True, "GUIDED", now_s)
    guard.locate(5.0, 5.0, now_s)
    return guard


def test_a_command_is_cut_to_the_limit_and_keeps_its_direction() -> None:
    guard = a_guard()
    guard.command(3.0, 4.0, 0.0)
    assert guard.velocity(0.0) == pytest.approx((1.2, 1.6))
    guard.command(math.inf, 0.0, 0.0)
    assert guard.velocity(0.0) == STAND


def test_a_stalled_agents_vehicle_stands_and_each_stall_counts_once() -> None:
    """A command holds for its time, not longer; the next one ends the stall."""
    guard = a_guard()
    guard.command(1.0, 0.0, 0.0)
    guard.locate(5.0, 5.0, 1.4)
    assert guard.velocity(1.4) == (1.0, 0.0)
    for now_s in (1.6, 1.7, 1.8):
        guard.locate(5.0, 5.0, now_s)
        assert guard.velocity(now_s) == STAND
    assert guard.stalls == 1
    guard.command(1.0, 0.0, 1.8)
    assert guard.velocity(1.8) == (1.0, 0.0)


def test_no_velocity_without_a_position() -> None:
    guard = Guard(LIMITS, SQUARE, 0.1)
    guard.beat(True, "GUIDED", 0.0)
    guard.command(1.0, 0.0, 0.0)
    guard.locate(math.nan, 5.0, 0.0)
    assert guard.velocity(0.0) == STAND
    guard.locate(5.0, 5.0, 0.0)
    assert guard.velocity(0.9) == (1.0, 0.0)
    assert guard.velocity(1.1) == STAND


def test_what_leads_out_is_refused_and_counted() -> None:
    guard = a_guard()
    guard.locate(9.0, 5.0, 0.0)
    guard.command(1.5, 0.0, 0.0)
    assert guard.velocity(0.0) == STAND
    assert guard.refused == 1
    guard.command(0.5, 0.0, 0.0)
    assert guard.velocity(0.0) == (0.5, 0.0)


def test_the_body_says_what_is_wrong() -> None:
    guard = Guard(LIMITS, SQUARE, 0.1)
    assert "heartbeat" in guard.sensed(0.0).fault
    guard.beat(False, "LOITER", 0.0)
    assert "no position" in guard.sensed(0.0).fault
    guard.locate(5.0, 5.0, 0.0)
    assert "not armed" in guard.sensed(0.0).fault
    guard.beat(True, "LOITER", 0.0)
    assert "mode LOITER" in guard.sensed(0.0).fault
    guard.beat(True, "GUIDED", 0.0)
    guard.set_uncertainty(0.7)
    guard.set_uncertainty(math.nan)
    assert guard.sensed(0.5) == (5.0, 5.0, 0.7, (), "")
    assert "no position" in guard.sensed(2.0).fault
    assert "heartbeat" in guard.sensed(4.0).fault
    free = Guard(dataclasses.replace(LIMITS, needs_armed=False, modes=()), SQUARE, 0.1)
    free.beat(False, "LOITER", 0.0)
    free.locate(5.0, 5.0, 0.0)
    assert not free.sensed(0.0).fault


def test_a_vehicle_that_is_not_the_agents_is_told_to_stand() -> None:
    """A person who gives it back must not find it told to go before the agent knows."""
    guard = a_guard()
    for is_armed, mode, told in (
        (True, "GUIDED", (1.0, 0.0)),
        (False, "GUIDED", STAND),
        (True, "LOITER", STAND),
        (True, "GUIDED", (1.0, 0.0)),
    ):
        guard.beat(is_armed, mode, 0.0)
        guard.command(1.0, 0.0, 0.0)
        assert guard.velocity(0.0) == told
    guard.command(1.0, 0.0, 3.5)
    guard.locate(5.0, 5.0, 3.5)
    assert guard.velocity(3.5) == STAND, "heartbeats ceased"


def test_a_vehicle_that_objects_stands_and_says_why() -> None:
    guard = a_guard()
    guard.command(1.0, 0.0, 0.0)
    guard.inhibit("on the ground")
    assert (guard.velocity(0.1), guard.sensed(0.1).fault) == (STAND, "on the ground")
    guard.inhibit("")
    assert (guard.velocity(0.1), guard.sensed(0.1).fault) == ((1.0, 0.0), "")


CHECKED = dataclasses.replace(LIMITS, jump_m=5.0, follow_s=5.0)
TENTH_S = 0.1


def flown(guard: Guard, share: float, steps: int, begin_s: float = 0.0, wish: Place = (0.0, 1.0)) -> list[str]:
    """The faults of a vehicle that moves at this share of what it is told, at ten set-points per second."""
    at, faults = (5.0, 1.0), []
    for step in range(steps):
        now_s = begin_s + TENTH_S * step
        guard.beat(True, "GUIDED", now_s)
        guard.locate(*at, now_s)
        guard.command(*wish, now_s)
        vx_mps, vy_mps = guard.velocity(now_s)
        at = (at[0] + share * vx_mps * TENTH_S, at[1] + share * vy_mps * TENTH_S)
        faults.append(guard.sensed(now_s).fault)
    return faults


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_vehicle_that_follows_is_not_doubted(share: float) -> None:
    assert not any(flown(Guard(CHECKED, SQUARE, 0.1), share, 85))


@pytest.mark.parametrize("share", [0.0, 0.1, -1.0])
def test_a_vehicle_that_does_not_follow_stands_and_says_so(share: float) -> None:
    guard = Guard(CHECKED, Fence([(-50, -50), (50, -50), (50, 50), (-50, 50)]), 0.1)
    faults = flown(guard, share, 130)
    assert not any(faults[:50])
    assert all("does not follow" in fault for fault in faults[52:98])
    assert not faults[104]


def test_a_position_that_jumps_is_doubted() -> None:
    """And the vehicle stands; what its speed allows is no jump."""
    guard = Guard(CHECKED, SQUARE, 0.1)
    guard.beat(True, "GUIDED", 0.0)
    for now_s, at, fault in ((0.0, (1.0, 1.0), ""), (0.5, (3.0, 1.0), ""), (0.6, (9.0, 1.0), "jumped by 6.0 m")):
        guard.locate(*at, now_s)
        guard.command(0.1, 0.0, now_s)
        assert fault in guard.sensed(now_s).fault
        assert (guard.velocity(now_s) == STAND) == bool(fault)


def jumped(**limits: Any) -> Guard:
    """A guard whose vehicle's position has jumped by 15 m within its fence, some time ago."""
    wide = Fence([(-50, -50), (50, -50), (50, 50), (-50, 50)])
    guard = Guard(dataclasses.replace(CHECKED, **limits), wide, 0.1)
    guard.beat(True, "GUIDED", 0.0)
    for now_s, x_m in ((0.0, 1.0), (0.1, 16.0), (59.9, 16.0)):
        guard.locate(x_m, 1.0, now_s)
    return guard


def moves(guard: Guard, now_s: float) -> bool:
    guard.locate(16.0, 1.0, now_s)
    guard.command(0.1, 0.0, now_s)
    return guard.velocity(now_s) != STAND


@pytest.mark.parametrize("now_s", [60.0, 3600.0])
def test_after_a_jump_a_vehicle_stands_until_a_person_says_so(now_s: float) -> None:
    """However long, and although its position is steady: the frame may have moved."""
    guard = jumped()
    guard.beat(True, "GUIDED", now_s)
    assert not moves(guard, now_s)
    assert "restart the agent" in guard.sensed(now_s).fault


@pytest.mark.parametrize(
    ("between", "goes_on"),
    [
        ([(True, "LOITER")], True),
        ([(False, "GUIDED")], True),
        ([(False, "LOITER"), (True, "LOITER")], True),
        ([], False),
        ([(True, "GUIDED")] * 20, False),
    ],
)
def test_a_pilot_who_gives_it_back_says_so(between: list[tuple[bool, str]], goes_on: bool) -> None:
    """By the flight mode, or by arming; heartbeats that say the same say nothing."""
    guard = jumped(modes=("GUIDED",), needs_armed=True)
    for state in [*between, (True, "GUIDED")]:
        guard.beat(*state, 60.0)
    assert moves(guard, 60.0) == goes_on


def test_a_second_jump_stops_it_again() -> None:
    guard = jumped(modes=("GUIDED",))
    guard.beat(True, "LOITER", 60.0)
    guard.beat(True, "GUIDED", 60.0)
    assert moves(guard, 60.0)
    guard.locate(1.0, 1.0, 60.1)
    assert not moves(guard, 120.0)


def test_outside_its_fence_a_vehicle_stands_and_says_so() -> None:
    """Nobody knows how it came there: a pilot brings it back."""
    guard = Guard(CHECKED, SQUARE, 0.1)
    guard.beat(True, "GUIDED", 0.0)
    guard.locate(12.0, 5.0, 0.0)
    guard.command(-1.0, 0.0, 0.0)
    assert guard.velocity(0.0) == STAND
    assert guard.sensed(0.0).fault == "the vehicle is outside its fence"
