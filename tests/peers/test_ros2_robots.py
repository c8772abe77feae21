"""A ROS 2 robot as a body, where the robot is a node that others wrote: ROS 2 itself, pyzeros, zenoh-ros2-sdk."""

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
from tests.support.ros2_robots import session
from tests.support.scripted import Scripted, scripted
from tests.support.swarms import wait_until

pytestmark = [pytest.mark.processes, pytest.mark.slow]

TASK = {"step_s": 0.2, "width_m": 20.0, "height_m": 20.0, "sensing_range_m": 4.0}
NAME = "/field/robot7"


@contextmanager
def a_body(port: int, **options: Any) -> Iterator[Ros2Body]:
    table = {"connect": [f"tcp/127.0.0.1:{port}"], "namespace": "/field/robot{id}", "max_speed_mps": 2.0, **options}
    body = Ros2Body(load(Ros2Settings, table), BodyContext(7, load(AgentSettings, TASK), Random(1)))
    try:
        yield body
    finally:
        body.close()


@contextmanager
def driven(node: str, **options: Any) -> Iterator[tuple[Ros2Body, Scripted, int]]:
    port = free_port()
    with session("router", f"tcp/127.0.0.1:{port}"), a_body(port, **options) as body, a_robot(node, port) as robot:
        wait_until(lambda: not body.sense(0.0).fault, "a robot that is well")
        yield body, robot, port


def a_robot(node: str, port: int, name: str = NAME, reliability: str = "reliable") -> Any:
    return scripted(Scripted, "tests.peers.robot", node, port, name, reliability)


def wait_for_fault(body: Ros2Body, text: str) -> None:
    go(body, lambda: text in body.sense(0.0).fault, f"the fault {text!r}")


def go(body: Ros2Body, until: Callable[[], Any], what: str, vx_mps: float = 1.0, vy_mps: float = 0.0) -> None:
    def commanded() -> bool:
        body.move(vx_mps, vy_mps, ())
        return bool(until())

    wait_until(commanded, what)


def speed_mps(robot: Scripted) -> float:
    return robot.track[-1][3] if robot.track else math.nan


def test_a_robot_goes_where_the_agent_wants_and_stands_without_odometry(node: str) -> None:
    with driven(node) as (body, robot, _):
        go(body, lambda: robot.track[-1][2] > 1.0, "a metre to the left", 0.0, 1.0)
        assert body.sense(0.0)[:3] == pytest.approx((robot.track[-1][1], robot.track[-1][2], 0.05), abs=0.3)
        robot.tell("blind")
        wait_for_fault(body, "no position")
        go(body, lambda: speed_mps(robot) == 0.0, "a stand")
        sent = robot.track[-1][4]
        go(body, lambda: robot.track[-1][4] > sent + 5, "commands of zero")
        robot.tell("see")
        go(body, lambda: speed_mps(robot) > 0.9, "speed again")


def test_a_robot_without_a_namespace_may_send_as_best_effort_and_have_a_clock_of_its_own(node: str) -> None:
    """The clock may be an hour late, and go back by half a second as if it was set; a jump to the past is a restart."""
    port = free_port()
    with session("router", f"tcp/127.0.0.1:{port}"), a_robot(node, port, "", "best_effort") as robot:
        robot.tell("clock -3600")
        with a_body(port, namespace="") as body:
            go(body, lambda: speed_mps(robot) > 0.9, "speed")
            robot.tell("clock -0.5")
            at_m = robot.track[-1][1]
            go(body, lambda: robot.track[-1][1] > at_m + 2.0, "two metres")
            assert body.sense(0.0).fault == ""
            robot.tell("clock -5")
            wait_for_fault(body, "its odometry restarted")


def test_two_robots_of_one_name_stand_and_so_does_one_that_somebody_else_commands(node: str) -> None:
    with driven(node, fixed_frame=True) as (body, robot, port):
        with a_robot(node, port) as second:
            wait_for_fault(body, f"two robots have its name: two publishers of {NAME}/odom")
            go(body, lambda: second.track[-1][4] > 5 and speed_mps(robot) == 0.0 == speed_mps(second), "a stand")
        go(body, lambda: speed_mps(robot) > 0.9, "the first one's speed")
        robot.tell("teleop")
        wait_for_fault(body, f"{NAME}/cmd_vel is also published by {NAME}/driver")
        go(body, lambda: speed_mps(robot) == 0.0, "a stand")


def test_a_robot_that_was_started_anew_stands_until_the_agent_is_too(node: str) -> None:
    """It may lie elsewhere in its new frame; a restart of the clock alone shows the same where its frame survives."""
    with driven(node) as (body, robot, port):
        go(body, lambda: speed_mps(robot) > 0.9, "speed")
        robot.end()
        wait_for_fault(body, f"no position from the vehicle; {NAME}/odom is not published")
        with a_robot(node, port) as second:
            wait_for_fault(body, "its odometry restarted")
            assert speed_mps(second) == 0.0
