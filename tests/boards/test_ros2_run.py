"""A run with `--boards` in which ROS 2 robots follow the bodies that the world simulates."""

from pathlib import Path

import pytest
import tomli_w

from tests.support.fields import endpoint, free_port
from tests.support.loops import Loop, loop
from tests.support.ros2_robots import fleet
from tests.support.swarms import wait_until

pytestmark = pytest.mark.processes

BOARDS = (1, 2, 3, 4, 5)
RUN = (
    "--record",
    "off",
    "--set",
    "run.clock=realtime",
    "--set",
    "run.duration_s=1000000",
    "--set",
    "run.step_s=0.5",
)


def start(run: Loop, router: int) -> None:
    """All boards, each with a robot that begins at (0, 0) and is fast enough to catch up with its simulated body."""
    for board in BOARDS:
        table = run.settings(board)
        options = {"connect": [endpoint(router)], "max_speed_mps": 2.0, "fence_margin_m": 50.0, "follow_s": 3.0}
        table["body"] |= {"follower": "ros2", "options": options}
        (run.folder / f"{board}.toml").write_text(tomli_w.dumps(table))
        run.start(board)


def wait_for_word(run: Loop, board: int, text: str) -> None:
    wait_until(lambda: text in run.said(board), f"board {board} says {text!r}")


def test_five_robots_follow_their_simulated_bodies_and_report_what_goes_wrong(tmp_path: Path) -> None:
    """The run is valid whatever the robots do: agents decide by the simulated bodies alone."""
    router = free_port()
    with fleet(router, *(f"/robot{board}" for board in BOARDS)) as robots, loop(tmp_path, BOARDS, *RUN) as run:
        start(run, router)
        for board in BOARDS:
            wait_for_word(run, board, "the robot is beside its simulated body")
        assert all(robot.commands > 0 for robot in robots.robots)
        blind, jumping, stuck, doubled = robots.robots[:4]
        blind.is_blind = stuck.is_stuck = True
        jumping.x_m += 30.0
        stuck.x_m += 3.0
        robots.add(doubled.name)
        wait_for_word(run, 1, "the robot is not well: no position from the vehicle")
        wait_for_word(run, 2, "the robot is not well: its position jumped by 30")
        wait_for_word(run, 3, "the robot is not well: it does not follow its set-points")
        wait_for_word(run, 4, "the robot is not well: two robots have its name")
        summary = run.stop()
    assert (summary["valid"], summary["agents_lost"]) == (True, [])
