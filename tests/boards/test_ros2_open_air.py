"""A swarm of ROS 2 robots in open air: each board drives a stand-in robot over rmw_zenoh's keys."""

import math
from pathlib import Path
from typing import Any

import pytest

from tests.support.fields import EVENT_AT, TASK, Boards, Listener, board_table, boards, endpoint, free_port, listening
from tests.support.ros2_robots import Fleet, fleet
from tests.support.swarms import wait_until

pytestmark = pytest.mark.processes

PLACES = (EVENT_AT, (1.0, 1.0), (19.0, 1.0), (19.0, 19.0), (1.0, 19.0))
"""Where robots begin: the first at the event, the others out of its radio range, in the corners."""

MEMBERS = {1, 2, 3, 4}


def tables(folder: Path, router: int) -> tuple[list[dict[str, Any]], list[str]]:
    ports = [free_port() for _ in PLACES]
    made = []
    for agent, at in enumerate(PLACES):
        links = {"listen": [endpoint(ports[agent])], "connect": [endpoint(port) for port in ports[:agent]]}
        table = board_table(agent, at, links, folder)
        options = {
            "connect": [endpoint(router)],
            "max_speed_mps": 2.0,
            "max_turn_radps": 1.5,
            "events": table["body"]["options"]["events"],
        }
        table["agent"] = TASK | {"step_s": 0.25, "speed_mps": 2.0}
        table["body"] = {"kind": "ros2", "arrive_m": 0.4, "options": options}
        made.append(table)
    return made, [endpoint(port) for port in ports]


def start_all(running: Boards, robots: Fleet, listener: Listener, made: list[dict[str, Any]]) -> None:
    for table, at in zip(made, PLACES, strict=True):
        robot = robots.add(f"/robot{table['id']}")
        robot.x_m, robot.y_m = at
        running.start(table)
        listener.wait_for(lambda: listener.path(0) == (0,), "a root, before another can be one")


def wait_for_word(running: Boards, agent: int, text: str) -> None:
    wait_until(lambda: f"the body is not well: {text}" in running.said(agent), f"agent {agent} says {text!r}")


@pytest.mark.slow  # how long walkers need to come back is chance, and real time
def test_five_robots_form_a_tree_and_report_what_goes_wrong(tmp_path: Path) -> None:
    """Each is driven to within range of the root; then one loses its odometry, one jumps, one has a twin."""
    router = free_port()
    made, endpoints = tables(tmp_path, router)
    with fleet(router) as robots, boards(tmp_path) as running, listening(*endpoints) as listener:
        start_all(running, robots, listener, made)
        listener.wait_for(lambda: listener.table(0) == MEMBERS, "a tree of five")
        for robot, start in list(zip(robots.robots, PLACES, strict=True))[1:]:
            assert math.dist((robot.x_m, robot.y_m), start) > 1.0
            assert robot.commands > 10
            assert math.dist((robot.x_m, robot.y_m), EVENT_AT) < 12.0

        blind, jumping, doubled = robots.robots[1:4]
        blind.is_blind = True
        wait_for_word(running, 1, "no position from the vehicle")
        jumping.x_m += 30.0
        wait_for_word(running, 2, "the vehicle is outside its fence")
        robots.add(doubled.name)
        wait_for_word(running, 3, "two robots have its name: two publishers of /robot3/odom")
        listener.wait_for(lambda: listener.table(0) == {4}, "a tree without them")

        blind.is_blind = False
        jumping.x_m -= 30.0
        robots.remove(robots.robots[-1])
        listener.wait_for(lambda: listener.table(0) == MEMBERS, "a tree of five again")
        assert [running.stop(agent) for agent in range(5)] == [0] * 5


def test_a_robot_that_does_not_move_says_so_until_it_does(tmp_path: Path) -> None:
    router = free_port()
    [_, table, *_], _ = tables(tmp_path, router)
    table["body"]["options"]["follow_s"] = 1.0
    with fleet(router, "/robot1") as robots, boards(tmp_path) as running:
        [robot] = robots.robots
        robot.is_stuck = True
        running.start(table)
        wait_for_word(running, 1, "it does not follow its set-points")
        robot.is_stuck = False
        wait_until(lambda: robot.x_m**2 + robot.y_m**2 > 4.0, "two metres of its walk")
        assert running.stop(1) == 0
        wait_until(lambda: robot.speed_mps == 0.0, "a stand at the end")
