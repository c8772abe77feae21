"""What a board with a MAVLink vehicle takes of its computer's memory."""

import json
import os
import subprocess
import sys

import pytest

from tests.support.fields import free_port

pytestmark = pytest.mark.processes

MAX_MB = 33.0 if sys.version_info < (3, 13) else 37.0
"""Python 3.13 itself takes 3 MB more."""
"""MiB resident on x86-64, where 31 were measured. An open Zenoh session takes 9.5 more: 40.5, or 42 MB."""

PROGRAM = """
import json, sys
from random import Random
import deltaswarm_board.__main__
from deltaswarm_board.bodies import find_body, make_body, options_of
from deltaswarm_agent.body import BodyContext
from deltaswarm_wire.settings import AgentSettings

kind = find_body("mavlink")
options = options_of(kind, {"device": sys.argv[1]})
body = make_body(kind, options, BodyContext(1, AgentSettings(), Random(1)))
body.move(1.0, 0.0, ())
body.sense(0.0)
body.close()
rows = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(json.dumps({"modules": sorted(sys.modules), "rss_kb": int(rows["VmRSS"].split()[0])}))
"""
"""A board's modules and a body at work, in a process that has imported nothing else."""


def test_a_board_with_a_vehicle_loads_one_dialect_and_no_more_than_it_may() -> None:
    """The `mavutil` of pymavlink would load a second dialect, and numpy where that is installed: 15 and 12 MB."""
    command = [sys.executable, "-c", PROGRAM, f"udpin:127.0.0.1:{free_port()}"]
    subprocess.run(command, check=True, capture_output=True)  # the first one may have to compile what it imports
    environment = {name: value for name, value in os.environ.items() if not name.startswith("COV")}
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    found = json.loads(done.stdout)
    dialects = [name for name in found["modules"] if name.startswith("pymavlink.dialects.v")]
    assert set(dialects) == {"pymavlink.dialects.v20", "pymavlink.dialects.v20.common"}
    too_much = {"pymavlink.mavutil", "numpy", "lxml", "xml", "ssl", "serial"}
    assert not too_much & set(found["modules"])
    if os.uname().machine == "x86_64":
        assert found["rss_kb"] / 1024 <= MAX_MB
