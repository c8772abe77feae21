"""A ROS 2 robot as a body, against a stand-in robot: real Zenoh on loopback."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from random import Random
from typing import Any

import pytest

from deltaswarm_agent.body import BodyContext
from deltaswarm_ros2.body import Ros2Body
from deltaswarm_ros2.settings import Ros2Settings
from deltaswarm_wire.checked import load
from deltaswarm_wire.settings import AgentSettings
from tests.support.fields import free_port
from tests.support.ros2_robots import TWIST_STAMPED, Fleet, Kind, Robot, fleet
from tests.support.swarms import wait_until
from tests.support.tiers import in_one_test

pytestmark = pytest.mark.processes

TASK = {"step_s": 0.2, "width_m": 20.0, "height_m": 20.0, "sensing_range_m": 4.0}
AGENT = 7
KIND = Kind()


@contextmanager
def a_body(port: int, **options: Any) -> Iterator[Ros2Body]:
    table = {"connect": [f"tcp/127.0.0.1:{port}"], "max_speed_mps": 2.0, "stall_s": 0.3, **options}
    body = Ros2Body(load(Ros2Settings, table), BodyContext(AGENT, load(AgentSettings, TASK), Random(1)))
    try:
        yield body
    finally:
        body.close()


@contextmanager
def driven(kind: Kind = KIND, **options: Any) -> Iterator[tuple[Ros2Body, Robot, Fleet]]:
    port = free_port()
    options |= {"layout": kind.layout, "domain": kind.domain, "command_type": kind.command_type}
    options |= {"use_sim_time": kind.sim_time, "drive": "holonomic" if kind.is_holonomic else "differential"}
    with fleet(port, f"/robot{AGENT}", **vars(kind)) as robots, a_body(port, **options) as body:
        wait_until(lambda: not body.sense(0.0).fault, "a robot that is well")
        yield body, robots.robots[0], robots


def go(body: Ros2Body, vx_mps: float, vy_mps: float, until: Callable[[], Any], what: str) -> None:
    def commanded() -> bool:
        body.move(vx_mps, vy_mps, ())
        return bool(until())

    wait_until(commanded, what)


def wait_for_fault(body: Ros2Body, text: str) -> None:
    go(body, 1.0, 0.0, lambda: text in body.sense(0.0).fault, f"the fault {text!r}")


@in_one_test("kind", [KIND, Kind(domain=42), Kind(layout="ros2dds"), Kind(command_type=TWIST_STAMPED)])
def test_a_robot_goes_where_the_agent_wants(kind: Kind) -> None:
    """In both formats of keys, and in a domain; positions come back in the arena's frame, with their uncertainty."""
    with driven(kind, origin_x_m=-5.0, origin_y_m=-2.0) as (body, robot, _):
        sensed = body.sense(0.0)
        assert sensed[:3] == pytest.approx((5.0, 2.0, 0.05))
        go(body, 0.0, 1.0, lambda: robot.y_m > 1.0, "a metre to the left")
        assert robot.heading_rad == pytest.approx(math.pi / 2, abs=0.3)
        go(body, -30.0, 0.0, lambda: robot.speed_mps == pytest.approx(2.0, abs=0.1), "the speed limit, back")
        wait_until(lambda: robot.speed_mps == 0.0, "a stand, as the agent says nothing more")
        assert robot.commands > 10
        wait_until(lambda: kind.layout == "ros2dds" or robot.knows_who_commands(), "the agent in the ROS graph")


def test_a_robot_that_turns_away_from_its_fence_does_not_cross_it() -> None:
    """It faces the fence, 0.3 m away, and shall go along it: an arc at full speed would lead 0.7 m across."""
    with driven(origin_x_m=-19.7, origin_y_m=-2.0, fence_margin_m=0.0) as (body, robot, _):
        nearest_m = [0.3]

        def has_gone_along() -> bool:
            nearest_m.append(0.3 - robot.x_m)
            return robot.y_m > 1.0

        go(body, 0.0, 2.0, has_gone_along, "a metre along the fence")
        assert min(nearest_m) > 0.0


def test_a_holonomic_robot_moves_sideways() -> None:
    with driven(Kind(is_holonomic=True)) as (body, robot, _):
        go(body, 0.0, -1.0, lambda: robot.y_m < -0.5, "half a metre to the right")
        assert (robot.x_m, robot.heading_rad) == pytest.approx((0.0, 0.0))


def test_commands_are_stamped_with_the_simulators_time() -> None:
    """A simulator that pauses, or that has not begun, is a fault."""
    with driven(Kind(sim_time=True, command_type=TWIST_STAMPED)) as (body, robot, robots):
        go(body, 1.0, 0.0, lambda: robot.x_m > 0.5, "half a metre ahead")
        robots.clock.is_paused = True
        wait_for_fault(body, "no /clock")
        robots.clock.is_paused = False
        go(body, 1.0, 0.0, lambda: not body.sense(0.0).fault, "the end of the pause")


def test_a_turned_arena_turns_both_ways() -> None:
    """With the arena's +x along the robot's +y, the arena's +y is the robot's -x."""
    with driven(turn_deg=90.0, origin_x_m=3.0, origin_y_m=-1.0) as (body, robot, _):
        assert body.sense(0.0)[:2] == pytest.approx((1.0, 3.0))
        go(body, 1.0, 0.0, lambda: robot.y_m > 0.5, "half a metre along the robot's y")


def test_lost_odometry_stops_the_robot_and_is_a_fault() -> None:
    with driven() as (body, robot, _):
        go(body, 1.0, 0.0, lambda: robot.speed_mps > 0.9, "speed")
        robot.is_blind = True
        wait_for_fault(body, "no position")
        go(body, 1.0, 0.0, lambda: robot.speed_mps == 0.0, "a stand")
        robot.is_blind = False
        go(body, 1.0, 0.0, lambda: robot.speed_mps > 0.9, "speed again")
        assert body.sense(0.0).fault == ""


def test_a_jump_of_the_odometry_stops_the_robot_and_is_a_fault() -> None:
    """The frame may have moved: until somebody restarts the agent."""
    with driven() as (body, robot, _):
        robot.x_m += 10.0
        wait_for_fault(body, "jumped by 10")
        go(body, 1.0, 0.0, lambda: robot.speed_mps == 0.0, "a stand")
        assert "restart the agent" in body.sense(0.0).fault


def test_a_robot_that_does_not_move_is_a_fault() -> None:
    with driven(follow_s=1.0) as (body, robot, _):
        robot.is_stuck = True
        wait_for_fault(body, "does not follow")


def test_two_robots_of_one_name_are_a_fault_until_one_is_gone() -> None:
    """The first one's odometry is believed meanwhile, and nobody moves."""
    with driven(fixed_frame=True) as (body, robot, robots):
        second = robots.add(robot.name)
        second.x_m = 9.0
        wait_for_fault(body, f"two robots have its name: two publishers of {robot.name}/odom")
        go(body, 1.0, 0.0, lambda: second.commands > 5 and robot.speed_mps == 0.0 == second.speed_mps, "a stand")
        robots.remove(second)
        go(body, 1.0, 0.0, lambda: not body.sense(0.0).fault, "its end")


@pytest.mark.parametrize("apart_m", [1.0, 9.0])
def test_two_robots_of_one_name_behind_bridges_show_by_two_streams(apart_m: float) -> None:
    """The bridge's messages do not say who sent them; neither robot moves."""
    with driven(Kind(layout="ros2dds")) as (body, robot, robots):
        second = robots.add(robot.name)
        second.x_m = apart_m
        wait_for_fault(body, "two streams of stamps or positions")
        go(body, 1.0, 0.0, lambda: robot.speed_mps == 0.0 == second.speed_mps, "a stand")


@pytest.mark.parametrize("fixed_frame", [False, True])
def test_a_restart_of_the_odometry_is_a_fault_unless_its_frame_survives_it(fixed_frame: bool) -> None:
    """Wheels count from zero again; a map does not."""
    with driven(fixed_frame=fixed_frame) as (body, robot, robots):
        robots.remove(robot)
        wait_for_fault(body, f"no position from the vehicle; {robot.name}/odom is not published")
        robots.add(robot.name)
        if fixed_frame:
            go(body, 1.0, 0.0, lambda: not body.sense(0.0).fault, "a robot that is well")
        else:
            wait_for_fault(body, "restarted")


@pytest.mark.parametrize("shared", [False, True])
def test_a_pilot_takes_the_robot_by_publishing_commands(shared: bool) -> None:
    """The agent stops it and sends nothing more, until the pilot's node is gone; unless others may command, too."""
    with driven(shared=shared) as (body, robot, robots):
        go(body, 1.0, 0.0, lambda: robot.speed_mps > 0.9, "speed")
        with robots.commanding(robot.name, "teleop") as put:
            if shared:
                sent = robot.commands
                go(body, 1.0, 0.0, lambda: robot.commands > sent + 10, "commands all the same")
                assert body.sense(0.0).fault == ""
                return
            wait_for_fault(body, "/robot7/cmd_vel is also published by /robot7/teleop")
            go(body, 1.0, 0.0, lambda: robot.speed_mps == 0.0, "a stand")
            at_m, before = robot.x_m, dict(robot.numbers)
            go(body, 1.0, 0.0, lambda: put(0.5) or robot.x_m > at_m + 0.5, "half a metre by the pilot")
            changed = [gid for gid, number in robot.numbers.items() if number != before.get(gid)]
            assert len(changed) == 1, "the agent says nothing"
        go(body, 1.0, 0.0, lambda: robot.speed_mps > 0.9, "the agent's speed again")


def test_another_frame_is_a_fault() -> None:
    """The arena's place in it is unknown."""
    with driven() as (body, robot, _):
        robot.frame_id = "map"
        wait_for_fault(body, "/robot7/odom is in the frame 'map' and not 'odom'")


def test_a_board_is_there_before_its_robot_and_says_what_is_missing() -> None:
    """First there is no router, then no robot, then one whose topics have other types."""
    port = free_port()
    with a_body(port, command_type="geometry_msgs/msg/TwistStamped") as body:
        wait_until(lambda: f"no link to tcp/127.0.0.1:{port}" in body.sense(0.0).fault, "word of the link")
        with fleet(port) as robots:
            wait_until(lambda: "/robot7/odom is not published" in body.sense(0.0).fault, "word of the robot")
            robot = robots.add("/robot7")
            robot.is_blind = True
            told = "cmd_vel is subscribed to as geometry_msgs::msg::dds_::Twist_/RIHS01_9c45bf16fe098 and not as"
            wait_until(lambda: told in body.sense(0.0).fault, "word of the type")


def test_detections_are_events_where_the_robot_says_that_they_are() -> None:
    """Relative to the robot or in its odometry's frame; without news they end."""
    with driven(detections="detections", origin_x_m=-5.0, origin_y_m=-2.0) as (body, robot, _):
        robot.heading_rad = math.pi / 2
        robot.detected = [(1.0, 0.5), (9.0, 9.0)]
        wait_until(lambda: body.sense(0.0).events, "an event")
        [event] = body.sense(0.0).events
        assert event[1:] == pytest.approx((6.0, 2.5))
        robot.detected = []
        wait_until(lambda: not body.sense(0.0).events, "its end")
