"""Messages and type hashes against ROS 2's own encoders, from the wheels `ros-*` (extra `peers`)."""

from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given

from deltaswarm_ros2.cdr import decode, encode
from deltaswarm_ros2.definitions import DEFINITIONS, HASHES, ODOMETRY
from tests.peers.nodes import genuine
from tests.support.ros2_types import built, messages
from tests.support.tiers import nightly

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2 itself: pip install -e '.[peers]'")


def in_ros(message_type: str, message: Mapping[str, Any]) -> Any:
    return built(genuine, message_type, message, lambda value, kind: bytes([value]) if kind == "byte" else value)


def test_type_hashes_are_those_of_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with rclpy.init():
        node = rclpy.create_node("hashes")
        for number, kind in enumerate(HASHES):
            node.create_publisher(genuine(kind), f"topic{number}", 10)
        told = [node.get_publishers_info_by_topic(f"/topic{number}")[0] for number in range(len(HASHES))]
    assert {found.topic_type: str(found.topic_type_hash) for found in told} == HASHES


@pytest.mark.parametrize("message_type", [ODOMETRY, *nightly(*DEFINITIONS)])
def test_bytes_are_those_of_ros(message_type: str) -> None:
    """Each side reads what the other writes. Bytes may differ only where ROS, too, reads nothing: in padding."""
    from rclpy.serialization import deserialize_message, serialize_message

    @given(messages(message_type))
    def holds(message: dict[str, Any]) -> None:
        ours, theirs = encode(message_type, message), serialize_message(in_ros(message_type, message))
        assert len(ours) == len(theirs)
        assert decode(message_type, theirs) == message
        inverted = bytes(byte if byte == other else 255 - byte for byte, other in zip(ours, theirs, strict=True))
        for data in (ours, inverted):
            assert deserialize_message(data, genuine(message_type)) == in_ros(message_type, message)

    holds()
