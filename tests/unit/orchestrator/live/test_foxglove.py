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


LAST = """
import sys
from deltaswarm_orchestrator.live.foxglove_server import FoxgloveServer
from deltaswarm_orchestrator.recording.transcriber import log_message
from tests.support.foxglove import viewing
from tests.support.swarms import wait_until

server = FoxgloveServer("here", 0, print)
with viewing(server.url) as viewer:
    with server:
        wait_until(server._channels["/log"].has_sinks, "a subscription")
        for number in range(20):
            server.put("/log", float(number), log_message(3, "run", "a line", float(number)))
            server.look(None)
    seen = [topic for _, (topic, _, _) in zip(range(20), viewer.messages())]
assert seen == ["/log"] * 20, seen
print("all")
"""


def test_the_last_messages_of_a_run_reach_a_viewer() -> None:
    """They come within a tenth of a second, of which only the first is due."""
    done = subprocess.run([sys.executable, "-c", LAST], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (0, "all\n"), done.stderr
