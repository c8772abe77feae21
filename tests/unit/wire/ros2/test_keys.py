"""Keys and tokens of ROS 2's topics on Zenoh, and what they say of who is at a topic."""

import pytest
from zenoh.ext import Int64, z_serialize

from deltaswarm_ros2.definitions import TWIST
from deltaswarm_ros2.keys import (
    NODE,
    PUBLISHER,
    RMW_ZENOH,
    ROS2DDS,
    SUBSCRIPTION,
    Attachment,
    AttachmentError,
    Graph,
    Node,
    decode_attachment,
    encode_attachment,
    endpoint_token,
    full_name,
    gid_of,
    is_name,
    node_token,
    topic_key,
)
from tests.support.tiers import in_one_test

STRING = "std_msgs/msg/String"
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
LISTENER = Node(2, "aac3178e146ba6f1fc6e6a4085e77f21", "", "listener")


@pytest.mark.parametrize(
    ("namespace", "key"),
    [
        ("", f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"),
        ("/robot1", f"0/robot1/chatter/std_msgs::msg::dds_::String_/{HASH}"),
    ],
)
def test_a_topics_key_has_domain_name_type_and_hash(namespace: str, key: str) -> None:
    assert topic_key(RMW_ZENOH, 0, full_name("chatter", namespace), STRING) == key


def test_the_bridges_key_is_the_topics_name_alone() -> None:
    assert topic_key(ROS2DDS, 7, full_name("cmd_vel", "/robot7"), TWIST) == "robot7/cmd_vel"


def test_tokens_are_those_of_the_documents_listener() -> None:
    assert node_token(LISTENER) == f"@ros2_lv/2/{LISTENER.session}/0/0/{NODE}/%/%/listener"
    token = endpoint_token(LISTENER, 10, SUBSCRIPTION, "/chatter", STRING)
    assert token == (
        f"@ros2_lv/2/{LISTENER.session}/0/10/MS/%/%/listener/%chatter/std_msgs::msg::dds_::String_/{HASH}/::,10:,:,:,,"
    )


def test_slashes_within_a_name_become_percent_signs() -> None:
    """In namespace and topic, so that a token always has as many parts."""
    token = endpoint_token(LISTENER._replace(namespace="/a/robot7"), 1, PUBLISHER, "/a/robot7/cmd_vel", TWIST)
    assert token.split("/")[7:10] == ["%a%robot7", "listener", "%a%robot7%cmd_vel"]


def test_an_attachment_is_33_bytes_little_endian() -> None:
    attachment = Attachment(258, 0x0123_4567_89AB_CDEF, bytes(range(16)))
    data = encode_attachment(attachment)
    assert data.hex() == "0201000000000000" + "efcdab8967452301" + "10" + bytes(range(16)).hex()
    assert data == z_serialize((Int64(attachment.number), Int64(attachment.time_ns), attachment.gid)).to_bytes()
    assert decode_attachment(data) == attachment
    assert decode_attachment(data[:16] + data[17:]) == attachment


@in_one_test("data", [b"", bytes(31), bytes(33), bytes(16) + b"\x10" + bytes(17)])
def test_other_attachments_are_errors(data: bytes) -> None:
    with pytest.raises(AttachmentError, match="33 bytes"):
        decode_attachment(data)


def test_an_id_belongs_to_one_token() -> None:
    assert gid_of("a") == gid_of("a") != gid_of("b")
    assert len(gid_of("a")) == 16


@in_one_test(("text", "holds"), [("cmd_vel", True), ("/a/b2", True), ("2b", False), ("a//b", False)])
def test_names_are_those_of_ros(text: str, holds: bool) -> None:
    assert is_name(text) is holds


ROBOT, AGENT = Node(0, "1", "/robot7", "driver"), Node(0, "2", "/robot7", "agent")
TOPIC = "/robot7/cmd_vel"


def test_a_topic_nobody_is_at_is_told() -> None:
    graph = Graph(TOPIC)
    graph.add(node_token(ROBOT))
    graph.add(endpoint_token(ROBOT, 1, PUBLISHER, TOPIC, TWIST))
    graph.add(endpoint_token(AGENT, 1, SUBSCRIPTION, TOPIC, TWIST))
    graph.add(endpoint_token(ROBOT, 2, SUBSCRIPTION, "/robot8/cmd_vel", TWIST))
    assert graph.mismatch("2", SUBSCRIPTION, TOPIC, TWIST) == "/robot7/cmd_vel is not subscribed to"


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ("TwistStamped_/RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b", "TwistStamped_/RIHS01_5f0fcd4f81d5d"),
        ("Twist_/TypeHashNotSupported", "Twist_/TypeHashNotSupported"),
    ],
)
def test_another_type_is_told_until_one_with_this_type_is_there(other: str, told: str) -> None:
    """Keys contain types and their hashes, so that the two never meet; Humble has no hashes."""
    graph = Graph(TOPIC)
    same = endpoint_token(ROBOT, 2, SUBSCRIPTION, TOPIC, TWIST)
    head, _, tail = same.partition("Twist_/")
    graph.add(f"{head}{other}/{tail.partition('/')[2]}")
    dds = "geometry_msgs::msg::dds_::"
    expected = f"/robot7/cmd_vel is subscribed to as {dds}{told} and not as {dds}Twist_/RIHS01_9c45bf16fe098"
    assert graph.mismatch("2", SUBSCRIPTION, TOPIC, TWIST) == expected
    graph.add(same)
    assert graph.mismatch("2", SUBSCRIPTION, TOPIC, TWIST) == ""
    graph.remove(same)
    assert graph.mismatch("2", SUBSCRIPTION, TOPIC, TWIST) == expected


def test_other_publishers_are_named() -> None:
    graph = Graph(TOPIC)
    pilot = Node(0, "3", "", "teleop")
    for node in (AGENT, ROBOT, pilot):
        for number in (1, 2):
            graph.add(endpoint_token(node, number, PUBLISHER, TOPIC, TWIST))
    assert graph.nodes("2", PUBLISHER, TOPIC) == ["/robot7/driver", "/teleop"]
    assert graph.nodes("2", SUBSCRIPTION, TOPIC) == []
