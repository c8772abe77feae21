"""What a board with a ROS 2 robot needs of its computer: pycdr2 besides what every agent needs."""

import json
import subprocess
import sys

import pytest

from tests.support.fields import free_port
from tests.support.ros2_robots import fleet

pytestmark = pytest.mark.processes

MAX_MB = 42.0 if sys.version_info < (3, 13) else 46.0
"""Resident with an open session, where 34 MB were measured (x86-64); an agent's own session takes 5 MB more."""

PROGRAM = """
import json, sys, time
for name in ("numpy", "rosbags", "rclpy", "xxhash"):
    sys.modules[name] = None
from random import Random
import deltaswarm_board.__main__
before = [name for name in sys.modules if "ros2" in name]
from deltaswarm_board.bodies import find_body, make_body, options_of
from deltaswarm_agent.body import BodyContext
from deltaswarm_wire.settings import AgentSettings

kind = find_body("ros2")
body = make_body(kind, options_of(kind, {"connect": [sys.argv[1]]}), BodyContext(1, AgentSettings(), Random(1)))
while body.sense(0.0).fault:
    time.sleep(0.02)
rows = dict(line.split(":", 1) for line in open("/proc/self/status"))
body.close()
print(json.dumps({"before": before, "rss_kb": int(rows["VmRSS"].split()[0])}))
"""
"""A board's modules and a body at work, in a process that has imported nothing else."""


def test_a_board_needs_no_other_package_and_little_memory() -> None:
    """And a board without this body loads nothing of it."""
    port = free_port()
    with fleet(port, "/robot1"):
        command = [sys.executable, "-c", PROGRAM, f"tcp/127.0.0.1:{port}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["before"] == []
    assert found["rss_kb"] / 1024 <= MAX_MB
