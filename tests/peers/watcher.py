"""Somebody who watches a run as a node of another implementation: `python -m tests.peers.watcher NODE PORT`.

For each message that it hears of a run with `--live ros2` it prints a row: the number of agents that a message's
markers show, and 0; or 0, and the number of values that a message's diagnostics have. Its input's end ends it.
"""

import json
import os
import sys
import threading
from typing import Any

from tests.peers.nodes import made


def main(kind: str, port: str) -> None:
    """Watch until standard input ends."""
    node = made(kind, int(port), "watcher", "")

    def tell(*row: int) -> None:
        print(json.dumps(row), flush=True)

    def markers(message: Any) -> None:
        tell(sum(len(marker.points) for marker in message.markers if marker.ns == "agents"), 0)

    def diagnostics(message: Any) -> None:
        tell(0, sum(len(status.values) for status in message.status))

    node.subscribe("visualization_msgs/msg/MarkerArray", "/deltaswarm/markers", markers)
    node.subscribe("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", diagnostics)
    reader = threading.Thread(target=sys.stdin.read, daemon=True)
    reader.start()
    while reader.is_alive():
        node.spin(0.1)
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
