"""A live view of a run for ROS 2's tools: markers for RViz and diagnostics, on rmw_zenoh's keys.

The orchestrator is a node of the ROS graph. Nothing here waits: what cannot be sent at once is dropped.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any, Self

import zenoh

from deltaswarm_field.ros2_messages import diagnostics, markers
from deltaswarm_orchestrator.live.foxglove_server import LiveError
from deltaswarm_orchestrator.live.observers import Paced, Seen
from deltaswarm_ros2.cdr import encode
from deltaswarm_ros2.definitions import DIAGNOSTIC_ARRAY, MARKER_ARRAY
from deltaswarm_ros2.keys import (
    PUBLISHER,
    RMW_ZENOH,
    Attachment,
    Node,
    encode_attachment,
    endpoint_token,
    gid_of,
    node_token,
    topic_key,
)
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.session import RouterLink, client_pairs, configured, without_sources

TOPICS = {MARKER_ARRAY: "/deltaswarm/markers", DIAGNOSTIC_ARRAY: "/diagnostics"}

ROUTER = "tcp/127.0.0.1:7447"
"""Where rmw_zenoh's router listens by default."""

DOMAIN = 0
OPEN_MS = 2000
"""Time for a connection to the ROS side's router [ms]."""


class Ros2Publisher:
    """The observer `ros2`, which publishes what it sees ten times per second of wall time.

    `connect` is the endpoint of the ROS side's Zenoh router; empty for `ROUTER`. Stamps are by `wall_ns` [Unix ns].
    """

    shows = f"{' and '.join(TOPICS.values())} in ROS 2; they show the truth"

    def __init__(
        self,
        connect: str,
        scenario: Scenario,
        wall_ns: Callable[[], int] = time.time_ns,
        paced: Paced | None = None,
    ) -> None:
        arena = scenario.arena
        self._side_m = max(arena.width_m, arena.height_m)
        self._threshold_hz = scenario.operator.threshold_hz
        self._wall_ns = wall_ns
        self._paced = paced or Paced()
        self._sent = 0
        endpoint = connect or ROUTER
        link = RouterLink(endpoint)
        pairs = [*client_pairs(link), ("connect/timeout_ms", OPEN_MS), ("connect/exit_on_failure", True)]
        try:
            self._session = zenoh.open(configured(zenoh.Config, pairs, link))
        except zenoh.ZError as error:
            told = without_sources(str(error))
            start = "start the router: ros2 run rmw_zenoh_cpp rmw_zenohd"
            raise LiveError(f"--live ros2 needs a Zenoh router at {endpoint}: {told}; {start}") from None
        node = Node(DOMAIN, str(self._session.zid()), "", "deltaswarm")
        tokens = {
            kind: endpoint_token(node, number, PUBLISHER, topic, kind)
            for number, (kind, topic) in enumerate(TOPICS.items(), start=1)
        }
        self._gids = {kind: gid_of(token) for kind, token in tokens.items()}
        self._publishers = {
            kind: self._session.declare_publisher(
                topic_key(RMW_ZENOH, DOMAIN, topic, kind), congestion_control=zenoh.CongestionControl.DROP
            )
            for kind, topic in TOPICS.items()
        }
        liveliness = self._session.liveliness()
        self._tokens = [liveliness.declare_token(token) for token in (node_token(node), *tokens.values())]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def look(self, seen: Seen) -> None:
        """Publish the newest step, if it is time."""
        truth = seen.newest_truth
        if truth is None or not self._paced.is_due():
            return
        sec, nanosec = divmod(self._wall_ns(), 1_000_000_000)
        stamp = {"sec": sec, "nanosec": nanosec}
        self._sent += 1
        self._publish(MARKER_ARRAY, markers(truth, self._side_m, stamp))
        self._publish(DIAGNOSTIC_ARRAY, diagnostics(truth, seen.newest_workload, self._threshold_hz, stamp))

    def _publish(self, kind: str, message: Mapping[str, Any]) -> None:
        attachment = encode_attachment(Attachment(self._sent, self._wall_ns(), self._gids[kind]))
        self._publishers[kind].put(encode(kind, message), attachment=attachment)
