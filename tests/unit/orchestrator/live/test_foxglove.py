"""The server for Foxglove by itself: what viewers get, and that none of them holds it up."""

import subprocess
import sys

PROGRAM = """
import json, sys, time
from deltaswarm_orchestrator.live.foxglove_server import FoxgloveServer
from tests.support.foxglove import stuck_at
from tests.support.swarms import wait_until

with FoxgloveServer("here", 0, print) as server:
    stuck = stuck_at(server.url)
    wait_until(server._channels["/log"].has_sinks, "a subscription")
    for number in range(100):
        server.put("/log", float(number), bytes(200_000))
    began_s = time.monotonic()
    server.look(None)
    print(json.dumps({"sent_s": time.monotonic() - began_s}))
"""


def test_a_viewer_that_does_not_read_does_not_keep_the_server() -> None:
    """With more on its way than all buffers hold: sending does not wait, and the process ends."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert '"sent_s"' in done.stdout
