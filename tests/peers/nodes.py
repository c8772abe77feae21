"""Nodes that others wrote, behind one interface: of ROS 2 itself, of `pyzeros`, of `zenoh-ros2-sdk`.

The last two speak rmw_zenoh's protocol themselves. ROS 2's wheels have only Fast DDS, so `Rclpy` has a `Relay` between
DDS and Zenoh beside its node.
"""

import abc
import importlib
import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from deltaswarm_ros2.keys import full_name
from deltaswarm_wire.session import use_one_worker_thread
from tests.support.ros2_robots import attached, dds_name, session
from tests.support.ros2_types import built

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

RELAY = "relay"

Publish = Callable[[Mapping[str, Any]], None]


def genuine(message_type: str, root: str = "") -> Any:
    """ROS 2's own class of a message, or that of a package which has the same modules."""
    package, _, name = message_type.split("/")
    return getattr(importlib.import_module(f"{root}{package}.msg"), name)


class Node(abc.ABC):
    """A node. It publishes messages that are dicts; those that it hears have their fields as attributes."""

    @abc.abstractmethod
    def advertise(self, message_type: str, topic: str, reliability: str = "reliable") -> Publish:
        """Declare a publisher, `reliable` or `best_effort`, and return what publishes."""

    @abc.abstractmethod
    def subscribe(self, message_type: str, topic: str, take: Callable[[Any], None]) -> None:
        """Declare a subscription."""

    def spin(self, for_s: float) -> None:
        """Let time pass, in which it hears."""
        time.sleep(for_s)


class Relay:
    """Passes a DDS domain's topics on to Zenoh and back, by rmw_zenoh's keys, tokens and attachments.

    Names, types, type hashes, qualities of service and publishers' ids are those that ROS tells. A topic that others
    subscribe to on DDS goes one way, from Zenoh.
    """

    def __init__(self, rclpy: Any, port: int) -> None:
        self.node = rclpy.create_node(RELAY)
        self._qos = importlib.import_module("rclpy.qos")
        self._session = session("client", f"tcp/127.0.0.1:{port}")
        self._joined: dict[bytes, list[Any]] = {}
        self._passed: dict[str, Any] = {}
        self.node.create_timer(0.1, self._look)

    def _look(self) -> None:
        """Take those who came and went."""
        found = {}
        for topic, _ in self.node.get_topic_names_and_types():
            ends = (*self.node.get_subscriptions_info_by_topic(topic), *self.node.get_publishers_info_by_topic(topic))
            for end in ends:
                if end.node_name != RELAY and "/_" not in topic and topic not in ("/rosout", "/parameter_events"):
                    found[bytes(end.endpoint_gid)] = (topic, end)
        for gid in self._joined.keys() - found.keys():
            for token in self._joined.pop(gid):
                token.undeclare()
        for gid, (topic, end) in found.items():
            if gid not in self._joined:
                self._joined[gid] = self._join(topic, end)

    def _join(self, topic: str, end: Any) -> list[Any]:
        qos, types = self._qos, f"{dds_name(end.topic_type)}/{end.topic_type_hash}"
        is_publisher = end.endpoint_type.name == "PUBLISHER"
        is_reliable = end.qos_profile.reliability == qos.ReliabilityPolicy.RELIABLE
        is_volatile = end.qos_profile.durability == qos.DurabilityPolicy.VOLATILE
        told_qos = f"{'' if is_reliable else 2}:{'' if is_volatile else 1}:,:,:,:,,"
        space = end.node_namespace.replace("/", "%")
        place, number = f"%/{space}/{end.node_name}", 2 * len(self._joined) + 1
        head = f"@ros2_lv/0/{self._session.zid()}/{number}"
        name = topic.replace("/", "%")
        tokens = (
            f"{head}/{number}/NN/{place}",
            f"{head}/{number + 1}/{'MP' if is_publisher else 'MS'}/{place}/{name}/{types}/{told_qos}",
        )
        key = f"0{topic}/{types}"
        if topic not in self._passed:
            message = genuine(end.topic_type)
            pass_on = self._from_dds if is_publisher else self._to_dds
            self._passed[topic] = pass_on(message, topic, key)
        return [self._session.liveliness().declare_token(token) for token in tokens]

    def _from_dds(self, message: Any, topic: str, key: str) -> Any:
        publisher = self._session.declare_publisher(key)

        def take(data: bytes, info: Mapping[str, Any]) -> None:
            attachment = attached(info["publication_sequence_number"], info["publisher_gid"]["data"])
            publisher.put(data, attachment=attachment)

        return self.node.create_subscription(message, topic, take, self._qos.qos_profile_sensor_data, raw=True)

    def _to_dds(self, message: Any, topic: str, key: str) -> Any:
        publisher = self.node.create_publisher(message, topic, 10)
        take = zenoh.handlers.Callback(lambda sample: publisher.publish(sample.payload.to_bytes()), indirect=False)
        return publisher, self._session.declare_subscriber(key, take)


class Rclpy(Node):
    """ROS 2 itself; its domain on DDS is the process's (`ROS_DOMAIN_ID`)."""

    def __init__(self, port: int, name: str, namespace: str) -> None:
        import rclpy

        rclpy.init()
        self._rclpy = rclpy
        self.node = rclpy.create_node(name, namespace=namespace or None)
        self._executor = rclpy.executors.SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._executor.add_node(Relay(rclpy, port).node)

    def advertise(self, message_type: str, topic: str, reliability: str = "reliable") -> Publish:
        kinds = importlib.import_module("rclpy.qos")
        qos = kinds.QoSProfile(depth=10, reliability=kinds.ReliabilityPolicy[reliability.upper()])
        publisher = self.node.create_publisher(genuine(message_type), topic, qos)
        return lambda message: publisher.publish(built(genuine, message_type, message))

    def subscribe(self, message_type: str, topic: str, take: Callable[[Any], None]) -> None:
        self.node.create_subscription(genuine(message_type), topic, take, 10)

    def spin(self, for_s: float) -> None:
        end_s = time.monotonic() + for_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            self._executor.spin_once(left_s)


class Pyzeros(Node):
    def __init__(self, port: int, name: str, namespace: str) -> None:
        from pyzeros.node import Node as ZenohNode

        self._kept: list[Any] = []
        self._node = ZenohNode(name, session=session("client", f"tcp/127.0.0.1:{port}"), namespace=namespace or "%")

    @staticmethod
    def _class(message_type: str) -> Any:
        return genuine(message_type, "ros2_pyterfaces.cyclone.")

    def advertise(self, message_type: str, topic: str, reliability: str = "reliable") -> Publish:
        from pyzeros.pub import Pub
        from pyzeros.qos import QosProfile

        publisher = Pub(self._class(message_type), topic, QosProfile(reliability=reliability), self._node)
        return lambda message: publisher.publish(built(self._class, message_type, message, lambda value, _: value))

    def subscribe(self, message_type: str, topic: str, take: Callable[[Any], None]) -> None:
        from pyzeros.sub import RawSub

        kind = self._class(message_type)
        self._kept = RawSub(
            kind, topic, lambda sample: take(kind.deserialize(sample.payload.to_bytes())), session=self._node
        )


class Sdk(Node):
    def __init__(self, port: int, name: str, namespace: str) -> None:
        from zenoh_ros2_sdk.message_registry import get_registry

        get_registry(
            str(Path(sys.prefix) / "share")
        )  # where ROS 2's wheels have their definitions; else it clones them
        self._where = {"node_name": name, "namespace": namespace or "/", "router_port": port}
        self._space, self._kept = namespace, []

    def advertise(self, message_type: str, topic: str, reliability: str = "reliable") -> Publish:
        from zenoh_ros2_sdk import ROS2Publisher
        from zenoh_ros2_sdk.qos import QosProfile, QosReliability

        qos = QosProfile(reliability=QosReliability[reliability.upper()])
        made = ROS2Publisher(full_name(topic, self._space), message_type, **self._where, qos=qos)
        store = made.session_mgr.store

        def publish(message: Mapping[str, Any]) -> None:
            made.publish(**vars(built(store.types.__getitem__, message_type, message)))

        return publish

    def subscribe(self, message_type: str, topic: str, take: Callable[[Any], None]) -> None:
        from zenoh_ros2_sdk import ROS2Subscriber

        self._kept = ROS2Subscriber(
            topic if topic[0] == "/" else f"{self._space}/{topic}", message_type, take, **self._where
        )


NODES: Mapping[str, type[Any]] = {"rclpy": Rclpy, "pyzeros": Pyzeros, "zenoh_ros2_sdk": Sdk}
"""By the package that each needs."""


def made(kind: str, port: int, name: str, namespace: str) -> Node:
    """Make a node. ROS 2 itself gets a domain on DDS of its own."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100) if kind == "rclpy" else "0"
    node: Node = NODES[kind](port, name, namespace)
    return node
