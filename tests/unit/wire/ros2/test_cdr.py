"""CDR, byte for byte against another implementation, both ways."""

import hashlib
import itertools
from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltaswarm_ros2.cdr import MAX_BYTES, CdrError, decode, encode
from deltaswarm_ros2.definitions import (
    DEFINITIONS,
    ODOMETRY,
    POSE_ARRAY,
    SEQUENCE,
    TWIST,
    TWIST_STAMPED,
    fields_of,
)
from tests.support.ros2_types import bag_decoded, bag_encoded
from tests.support.tiers import in_one_test

BASIC: Mapping[str, st.SearchStrategy[Any]] = {
    "int32": st.integers(-(2**31), 2**31 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "uint8": st.integers(0, 255),
    "byte": st.integers(0, 127),  # rosbags takes it as signed
    "bool": st.booleans(),
    "float32": st.floats(allow_nan=False, width=32),
    "float64": st.floats(allow_nan=False),
    "string": st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9),
}


def messages(message_type: str) -> st.SearchStrategy[Any]:
    """Any message of a type."""
    made: dict[str, st.SearchStrategy[Any]] = {}
    for field in fields_of(message_type):
        one = BASIC[field.type] if field.type in BASIC else messages(field.type)
        if field.length is None:
            made[field.name] = one
        else:
            sizes = (0, 2) if field.length == SEQUENCE else (field.length, field.length)
            made[field.name] = st.lists(one, min_size=sizes[0], max_size=sizes[1]).map(tuple)
    return st.fixed_dictionaries(made)


@in_one_test("message_type", DEFINITIONS)
def test_bytes_are_those_of_rosbags(message_type: str) -> None:
    """Alignment after strings of every length, arrays, sequences; each reads what the other writes."""

    @settings(max_examples=25)
    @given(messages(message_type))
    def holds(message: dict[str, Any]) -> None:
        data = encode(message_type, message)
        assert data == bag_encoded(message_type, message)
        assert decode(message_type, data) == message
        assert bag_decoded(message_type, data) == message

    holds()


LENGTHS_AND_HASHES = {
    "builtin_interfaces/msg/Time": (12, "0d1e88fa201633a6"),
    "std_msgs/msg/Header": (20, "7f4778cda854a7c6"),
    "geometry_msgs/msg/Vector3": (28, "8e35f50079932cc4"),
    "geometry_msgs/msg/Point": (28, "8e35f50079932cc4"),
    "geometry_msgs/msg/Quaternion": (36, "b667f7bc5dd8c848"),
    "geometry_msgs/msg/Pose": (60, "34301a95f9dd22e4"),
    "geometry_msgs/msg/PoseWithCovariance": (348, "399de0c032f212da"),
    "geometry_msgs/msg/Twist": (52, "cab56a397cd1dca6"),
    "geometry_msgs/msg/TwistWithCovariance": (340, "1885c91775adefe2"),
    "geometry_msgs/msg/TwistStamped": (68, "a7e5185d0cd9578c"),
    "geometry_msgs/msg/PoseStamped": (76, "f22b55e858352294"),
    "geometry_msgs/msg/PoseArray": (196, "1ab8af59b1962bef"),
    "nav_msgs/msg/Odometry": (716, "d604c9b4e9fdb8a1"),
    "rosgraph_msgs/msg/Clock": (12, "0d1e88fa201633a6"),
    "std_msgs/msg/String": (10, "0a495e4d6a912a23"),
    "builtin_interfaces/msg/Duration": (12, "0d1e88fa201633a6"),
    "std_msgs/msg/ColorRGBA": (20, "cb97dfc7dcd5eef2"),
    "sensor_msgs/msg/CompressedImage": (39, "a6367ebafb65859f"),
    "visualization_msgs/msg/UVCoordinate": (12, "685c5fa51b1657c4"),
    "visualization_msgs/msg/MeshFile": (19, "b038607376137d5b"),
    "visualization_msgs/msg/Marker": (384, "0e8b8b09c7c4b77f"),
    "visualization_msgs/msg/MarkerArray": (1152, "35568f255bed80b5"),
    "diagnostic_msgs/msg/KeyValue": (19, "d1a9c6ae2d9eba20"),
    "diagnostic_msgs/msg/DiagnosticStatus": (89, "d138a757cc4a4983"),
    "diagnostic_msgs/msg/DiagnosticArray": (276, "3a90f1d3bbfa45be"),
}
"""Of the messages of `counted`, as releases without pycdr2 have sent them; the beginning of their SHA-256."""


def counted(message_type: str) -> dict[str, Any]:
    """A message whose values are 1, 2, 3, ...; sequences have three entries."""
    numbers = itertools.count(1)

    def one(kind: str) -> Any:
        if kind in DEFINITIONS:
            return message(kind)
        number = next(numbers)
        return {"string": "x" * (number % 5), "bool": bool(number % 2)}.get(kind, number % 100)

    def message(kind: str) -> dict[str, Any]:
        return {
            name: one(field) if length is None else [one(field) for _ in range(length or 3)]
            for name, field, length in fields_of(kind)
        }

    return message(message_type)


@in_one_test("message_type", DEFINITIONS)
def test_bytes_are_those_of_earlier_releases(message_type: str) -> None:
    """Of every type."""
    data = encode(message_type, counted(message_type))
    assert (len(data), hashlib.sha256(data).hexdigest()[:16]) == LENGTHS_AND_HASHES[message_type]


def test_a_twist_is_52_bytes() -> None:
    """The header, then six doubles, little-endian."""
    data = encode(TWIST, {"linear": {"x": 1.0}, "angular": {"z": -0.5}})
    assert data.hex() == "00010000" + "000000000000f03f" + "00" * 32 + "000000000000e0bf"


def test_doubles_after_a_string_are_aligned_from_the_end_of_the_header() -> None:
    """`odom` and its NUL end at byte 17 after the header; the first double begins at byte 24."""
    message = {"header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "odom"}, "twist": {"linear": {"x": 1.0}}}
    data = encode(TWIST_STAMPED, message)
    assert data[4:28].hex() == "01000000" + "02000000" + "05000000" + "6f646f6d00" + "00" * 7
    assert data[28:36].hex() == "000000000000f03f"


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
