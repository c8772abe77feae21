"""The Zenoh session of a ROS 2 robot's board: its topics as a node of ROS has them.

This is the only file of the body that uses Zenoh. Samples arrive in Zenoh's own thread.
"""

import logging
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from deltaswarm_ros2.cdr import decode, encode
from deltaswarm_ros2.keys import (
    PUBLISHER,
    RMW_ZENOH,
    SUBSCRIPTION,
    Attachment,
    Graph,
    Node,
    all_tokens,
    decode_attachment,
    encode_attachment,
    endpoint_token,
    gid_of,
    node_token,
    topic_key,
)
from deltaswarm_ros2.settings import CLIENT, Ros2Settings
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.session import RouterLink, air_pairs, configured, use_one_worker_thread, without_sources

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.ros2")

OPEN_MS = 500
"""A client's session that has no router by then is tried anew."""

Hear = Callable[[Mapping[str, Any], bytes], None]
"""Takes a message and its publisher's id, which is empty without rmw_zenoh; raises ValueError if it is no good."""


class Topic(NamedTuple):
    name: str
    type: str


class Ros2Link:
    """The node of one agent. Every method except `close` raises OSError if Zenoh does."""

    def __init__(self, options: Ros2Settings, agent: int, command: Topic, heard: Mapping[Topic, Hear]) -> None:
        self._options = options
        self._agent = agent
        self._command = command
        self._heard = heard
        self._graph = Graph(command.name, *(topic.name for topic in heard))
        self._session: zenoh.Session | None = None
        self._declared: list[Any] = []
        self._publisher: zenoh.Publisher | None = None
        self._gid = b""
        self._sent = 0
        self._told: set[tuple[str, str]] = set()
        pairs = air_pairs(options.mode, options.connect, options.listen)
        if options.mode == CLIENT:
            pairs += [("connect/timeout_ms", OPEN_MS), ("connect/exit_on_failure", True)]
        overrides = tuple(options.zenoh.items())
        try:
            self._config = configured(zenoh.Config, pairs, RouterLink("", overrides=overrides))
        except ValueError as error:
            problem = Problem("body.options.zenoh", str(options.zenoh), f"must be of use: {error}")
            raise SettingsError([problem]) from None

    def open(self) -> None:
        """Open the session if it is closed, and declare the node and its topics."""
        if self._session is not None:
            return
        try:
            self._session = zenoh.open(self._config)
            self._declare(self._session)
        except zenoh.ZError as error:
            raise OSError(without_sources(str(error))) from error

    @property
    def is_linked(self) -> bool:
        """Whether there is a link to a router, bridge or peer."""
        session = self._session
        return session is not None and bool(session.info.routers_zid() or session.info.peers_zid())

    def send(self, message: Mapping[str, Any]) -> None:
        if self._publisher is None:
            return
        self._sent += 1
        attachment = encode_attachment(Attachment(self._sent, time.time_ns(), self._gid)) if self._gid else None
        try:
            self._publisher.put(encode(self._command.type, message), attachment=attachment)
        except zenoh.ZError as error:
            raise OSError(without_sources(str(error))) from error

    def mismatches(self, odometry: Topic) -> list[str]:
        """Return what the ROS graph lacks for the robot to be driven; nothing is known of it without rmw_zenoh."""
        if self._session is None or self._options.layout != RMW_ZENOH:
            return []
        session = str(self._session.zid())
        found = [
            self._graph.mismatch(session, PUBLISHER, *odometry),
            self._graph.mismatch(session, SUBSCRIPTION, *self._command),
        ]
        return [text for text in found if text]

    def commanders(self) -> list[str]:
        """Return the other nodes that publish commands; nothing is known of them without rmw_zenoh."""
        session = self._session
        return self._graph.nodes(str(session.zid()), PUBLISHER, self._command.name) if session else []

    def close(self) -> None:
        session, self._session, self._publisher = self._session, None, None
        self._declared.clear()
        if session is not None:
            session.close()

    def _declare(self, session: zenoh.Session) -> None:
        options, is_rmw = self._options, self._options.layout == RMW_ZENOH
        namespace = options.namespace_of(self._agent)
        node = Node(options.domain, str(session.zid()), namespace, f"deltaswarm_agent_{self._agent}")
        tokens = [node_token(node)] if is_rmw else []
        for number, (topic, hear) in enumerate(self._heard.items(), start=2):
            key = topic_key(options.layout, options.domain, *topic)
            callback = zenoh.handlers.Callback(self._receiver(topic, hear), indirect=False)
            self._declared.append(session.declare_subscriber(key, callback))
            tokens += [endpoint_token(node, number, SUBSCRIPTION, *topic)] if is_rmw else []
        publisher = session.declare_publisher(
            topic_key(options.layout, options.domain, *self._command),
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE,
        )
        if is_rmw:
            token = endpoint_token(node, 1, PUBLISHER, *self._command)
            self._gid = gid_of(token)
            liveliness = session.liveliness()
            everything = zenoh.handlers.Callback(self._on_token, indirect=False)
            self._declared += [
                liveliness.declare_subscriber(all_tokens(options.domain), everything, history=True),
                *(liveliness.declare_token(text) for text in (*tokens, token)),
            ]
        self._publisher = publisher
        log.info("%s publishes %s as %s", node.name, self._command.name, self._command.type)

    # In Zenoh's thread

    def _on_token(self, sample: zenoh.Sample) -> None:
        change = self._graph.add if sample.kind == zenoh.SampleKind.PUT else self._graph.remove
        change(str(sample.key_expr))

    def _receiver(self, topic: Topic, hear: Hear) -> Callable[[zenoh.Sample], None]:
        def receive(sample: zenoh.Sample) -> None:
            try:
                gid = self._gid_in(sample.attachment) if self._options.layout == RMW_ZENOH else b""
                hear(decode(topic.type, sample.payload.to_bytes()), gid)
            except ValueError as error:
                if (topic.name, str(error)) not in self._told and len(self._told) < 100:
                    self._told.add((topic.name, str(error)))
                    log.warning("dropped a message on %s: %s", topic.name, error)

        return receive

    @staticmethod
    def _gid_in(attachment: zenoh.ZBytes | None) -> bytes:
        return decode_attachment(attachment.to_bytes() if attachment else b"").gid
