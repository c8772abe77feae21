"""CDR, byte for byte against another implementation, both ways."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_ros2.cdr import MAX_BYTES, CdrError, decode, encode
from deltaswarm_ros2.definitions import DEFINITIONS, ODOMETRY, POSE_ARRAY, TWIST
from tests.support.ros2_types import bag_decoded, bag_encoded, messages
from tests.support.tiers import in_one_test


@in_one_test("message_type", DEFINITIONS)
def test_bytes_are_those_of_rosbags(message_type: str) -> None:
    """Alignment after strings of every length, arrays, sequences; each reads what the other writes."""

    @given(messages(message_type))
    def holds(message: dict[str, Any]) -> None:
        data = encode(message_type, message)
        assert data == bag_encoded(message_type, message)
        assert decode(message_type, data) == message
        assert bag_decoded(message_type, data) == message

    holds()


def test_a_twist_is_52_bytes() -> None:
    """The header, then six doubles, little-endian."""
    data = encode(TWIST, {"linear": {"x": 1.0}, "angular": {"z": -0.5}})
    assert data.hex() == "00010000" + "000000000000f03f" + "00" * 32 + "000000000000e0bf"


def test_the_other_byte_order_and_padding_are_read() -> None:
    """DDS may send big-endian, and fills a message up to a multiple of four bytes."""
    message = {"data": "big"}
    data = bytes.fromhex("00000000" + "00000004" + "62696700")
    assert decode("std_msgs/msg/String", data) == decode("std_msgs/msg/String", data + bytes(3)) == message


@in_one_test(
    ("message_type", "data", "message"),
    [
        (TWIST, b"", "must begin with"),
        (TWIST, bytes.fromhex("00070000") + bytes(48), "must begin with"),
        (TWIST, bytes.fromhex("00010000") + bytes(47), "all of its fields .got 51 bytes"),
        (TWIST, bytes.fromhex("00010000") + bytes(52), "must end after 52 bytes .got 56"),
        ("std_msgs/msg/String", bytes.fromhex("00010000" + "ffffffff"), "all of its fields"),
        ("std_msgs/msg/String", bytes(MAX_BYTES + 1), f"at most {MAX_BYTES} bytes"),
        (
            "visualization_msgs/msg/MeshFile",
            bytes.fromhex("00010000" + "0100000000000000" + "05000000" + "01"),
            "all of its fields",
        ),
        (
            "std_msgs/msg/String",
            bytes.fromhex("00010000" + "02000000" + "ff00"),
            "all of its fields .got 10 bytes: .utf-8",
        ),
        (
            POSE_ARRAY,
            bytes.fromhex("00010000") + bytes(8) + bytes.fromhex("0100000000000000ffff0000"),
            "all of its fields",
        ),
    ],
)
def test_what_is_no_message_is_an_error(message_type: str, data: bytes, message: str) -> None:
    with pytest.raises(CdrError, match=message):
        decode(message_type, data)


@given(st.sampled_from((ODOMETRY, POSE_ARRAY)), st.binary(max_size=200))
def test_any_bytes_are_a_message_or_an_error(message_type: str, data: bytes) -> None:
    try:
        decode(message_type, b"\0\1\0\0" + data)
    except CdrError:
        return


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ({"linaer": {}}, "no field linaer"),
        ({"linear": {"x": "fast"}}, "values that fit"),
        ({"linear": 3}, "values that fit"),
    ],
)
def test_what_does_not_fit_is_an_error(message: dict[str, Any], error: str) -> None:
    with pytest.raises(CdrError, match=error):
        encode(TWIST, message)


def test_an_array_has_its_length() -> None:
    with pytest.raises(CdrError, match="covariance must have 36 values"):
        encode("geometry_msgs/msg/PoseWithCovariance", {"covariance": (1.0, 2.0)})
