"""Two other implementations of CDR for the same messages: the package rosbags, and pycdr2, an IDL serialiser.

They share no code with each other or with deltaswarm. A message is a dict, as in `deltaswarm_wire.ros2.cdr`.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pycdr2 import IdlStruct
from pycdr2.types import array, float64, int32, sequence, uint32
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)


@dataclass
class Time(IdlStruct, typename="builtin_interfaces/msg/Time"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs/msg/Header"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs/msg/Vector3"):
    x: float64
    y: float64
    z: float64


@dataclass
class Point(IdlStruct, typename="geometry_msgs/msg/Point"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs/msg/Quaternion"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs/msg/Pose"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs/msg/PoseWithCovariance"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Twist(IdlStruct, typename="geometry_msgs/msg/Twist"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs/msg/TwistWithCovariance"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs/msg/TwistStamped"):
    header: Header
    twist: Twist


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs/msg/PoseStamped"):
    header: Header
    pose: Pose


@dataclass
class PoseArray(IdlStruct, typename="geometry_msgs/msg/PoseArray"):
    header: Header
    poses: sequence[Pose]


@dataclass
class Odometry(IdlStruct, typename="nav_msgs/msg/Odometry"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs/msg/Clock"):
    clock: Time


@dataclass
class String(IdlStruct, typename="std_msgs/msg/String"):
    data: str


IDL: dict[str, Any] = {
    found.__idl_typename__: found
    for found in list(vars().values())
    if isinstance(found, type) and issubclass(found, IdlStruct) and found is not IdlStruct
}
"""The classes by type."""


def _built(message_type: str, message: Mapping[str, Any], classes: Any, many: Any) -> Any:
    """An instance of the classes, with those of its fields."""
    made = {}
    for spec in dataclasses.fields(IDL[message_type]):
        value, kind = message[spec.name], spec.type
        inner = getattr(kind, "__idl_typename__", "")
        if inner:
            made[spec.name] = _built(inner, value, classes, many)
        elif isinstance(value, Sequence) and not isinstance(value, str):
            made[spec.name] = many(
                [_built("geometry_msgs/msg/Pose", entry, classes, list) for entry in value]
                if spec.name == "poses"
                else value
            )
        else:
            made[spec.name] = value
    return classes[message_type](**made)


def idl_encoded(message_type: str, message: Mapping[str, Any]) -> bytes:
    """Encode by pycdr2."""
    return bytes(_built(message_type, message, IDL, list).serialize())


def idl_decoded(message_type: str, data: bytes) -> dict[str, Any]:
    """Decode by pycdr2."""
    return _plain(dataclasses.asdict(IDL[message_type].deserialize(data)))


def bag_encoded(message_type: str, message: Mapping[str, Any]) -> bytes:
    """Encode by rosbags."""

    def many(values: list[Any]) -> Any:
        return np.array(values) if values and isinstance(values[0], float) else values

    return bytes(STORE.serialize_cdr(_built(message_type, message, STORE.types, many), message_type))


def bag_decoded(message_type: str, data: bytes) -> dict[str, Any]:
    """Decode by rosbags."""
    return _plain(dataclasses.asdict(STORE.deserialize_cdr(data, message_type)))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items() if name != "__msgtype__"}
    return tuple(map(_plain, value)) if isinstance(value, list | tuple | np.ndarray) else value
