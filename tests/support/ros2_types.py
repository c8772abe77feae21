"""Two other implementations of CDR for the same messages: the package rosbags, and pycdr2, an IDL serialiser.

They share no code with each other or with deltaswarm. A message is a dict, as in `deltaswarm_ros2.cdr`.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pycdr2 import IdlStruct
from pycdr2.types import array, float32, float64, int32, sequence, uint8, uint32
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


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces/msg/Duration"):
    sec: int32
    nanosec: uint32


@dataclass
class ColorRGBA(IdlStruct, typename="std_msgs/msg/ColorRGBA"):
    r: float32
    g: float32
    b: float32
    a: float32


@dataclass
class CompressedImage(IdlStruct, typename="sensor_msgs/msg/CompressedImage"):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class UVCoordinate(IdlStruct, typename="visualization_msgs/msg/UVCoordinate"):
    u: float32
    v: float32


@dataclass
class MeshFile(IdlStruct, typename="visualization_msgs/msg/MeshFile"):
    filename: str
    data: sequence[uint8]


@dataclass
class Marker(IdlStruct, typename="visualization_msgs/msg/Marker"):
    header: Header
    ns: str
    id: int32
    type: int32
    action: int32
    pose: Pose
    scale: Vector3
    color: ColorRGBA
    lifetime: Duration
    frame_locked: bool
    points: sequence[Point]
    colors: sequence[ColorRGBA]
    texture_resource: str
    texture: CompressedImage
    uv_coordinates: sequence[UVCoordinate]
    text: str
    mesh_resource: str
    mesh_file: MeshFile
    mesh_use_embedded_materials: bool


@dataclass
class MarkerArray(IdlStruct, typename="visualization_msgs/msg/MarkerArray"):
    markers: sequence[Marker]


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs/msg/KeyValue"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs/msg/DiagnosticStatus"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs/msg/DiagnosticArray"):
    header: Header
    status: sequence[DiagnosticStatus]


IDL: dict[str, Any] = {
    found.__idl_typename__: found
    for found in list(vars().values())
    if isinstance(found, type) and issubclass(found, IdlStruct) and found is not IdlStruct
}
"""The classes by type."""


ELEMENTS = {
    "poses": "geometry_msgs/msg/Pose",
    "points": "geometry_msgs/msg/Point",
    "colors": "std_msgs/msg/ColorRGBA",
    "uv_coordinates": "visualization_msgs/msg/UVCoordinate",
    "markers": "visualization_msgs/msg/Marker",
    "status": "diagnostic_msgs/msg/DiagnosticStatus",
    "values": "diagnostic_msgs/msg/KeyValue",
}
"""Types of the elements of sequences of messages, by the names of these."""


def _built(message_type: str, message: Mapping[str, Any], classes: Any, many: Any) -> Any:
    """An instance of the classes, with those of its fields; `many` makes an array or sequence of numbers."""
    made = {}
    for spec in dataclasses.fields(IDL[message_type]):
        value, inner = message[spec.name], getattr(spec.type, "__idl_typename__", "")
        if inner:
            made[spec.name] = _built(inner, value, classes, many)
        elif spec.name in ELEMENTS:
            made[spec.name] = [_built(ELEMENTS[spec.name], entry, classes, many) for entry in value]
        else:
            made[spec.name] = many(value) if isinstance(value, Sequence) and not isinstance(value, str) else value
    return classes[message_type](**made)


def idl_encoded(message_type: str, message: Mapping[str, Any]) -> bytes:
    """Encode by pycdr2."""
    return bytes(_built(message_type, message, IDL, list).serialize())


def idl_decoded(message_type: str, data: bytes) -> dict[str, Any]:
    """Decode by pycdr2."""
    return _plain(dataclasses.asdict(IDL[message_type].deserialize(data)))


def bag_encoded(message_type: str, message: Mapping[str, Any]) -> bytes:
    """Encode by rosbags."""

    def many(values: Sequence[Any]) -> Any:
        return np.array(values, np.float64 if values and isinstance(values[0], float) else np.uint8)

    return bytes(STORE.serialize_cdr(_built(message_type, message, STORE.types, many), message_type))


def bag_decoded(message_type: str, data: bytes) -> dict[str, Any]:
    """Decode by rosbags."""
    return _plain(dataclasses.asdict(STORE.deserialize_cdr(data, message_type)))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        # Without rosbags' constants, in capitals, and its `__msgtype__`.
        return {name: _plain(entry) for name, entry in value.items() if name.islower() and name[0] != "_"}
    return tuple(map(_plain, value)) if isinstance(value, list | tuple | bytes | np.ndarray) else value
