"""ROS 2's messages that deltaswarm exchanges, as their packages define them, and the type hashes of these definitions.

The hash is RIHS01: the SHA-256 of the type's description, and of every type that it refers to, as JSON.
"""

import json
import re
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
POSE_ARRAY = "geometry_msgs/msg/PoseArray"
ODOMETRY = "nav_msgs/msg/Odometry"
CLOCK = "rosgraph_msgs/msg/Clock"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"

DEFINITIONS = MappingProxyType(
    {
        "builtin_interfaces/msg/Time": "int32 sec, uint32 nanosec",
        "std_msgs/msg/Header": "builtin_interfaces/Time stamp, string frame_id",
        "geometry_msgs/msg/Vector3": "float64 x, float64 y, float64 z",
        "geometry_msgs/msg/Point": "float64 x, float64 y, float64 z",
        "geometry_msgs/msg/Quaternion": "float64 x, float64 y, float64 z, float64 w",
        "geometry_msgs/msg/Pose": "geometry_msgs/Point position, geometry_msgs/Quaternion orientation",
        "geometry_msgs/msg/PoseWithCovariance": "geometry_msgs/Pose pose, float64[36] covariance",
        TWIST: "geometry_msgs/Vector3 linear, geometry_msgs/Vector3 angular",
        "geometry_msgs/msg/TwistWithCovariance": "geometry_msgs/Twist twist, float64[36] covariance",
        TWIST_STAMPED: "std_msgs/Header header, geometry_msgs/Twist twist",
        POSE_STAMPED: "std_msgs/Header header, geometry_msgs/Pose pose",
        POSE_ARRAY: "std_msgs/Header header, geometry_msgs/Pose[] poses",
        ODOMETRY: "std_msgs/Header header, string child_frame_id, geometry_msgs/PoseWithCovariance pose,"
        " geometry_msgs/TwistWithCovariance twist",
        CLOCK: "builtin_interfaces/Time clock",
        "std_msgs/msg/String": "string data",
        "builtin_interfaces/msg/Duration": "int32 sec, uint32 nanosec",
        "std_msgs/msg/ColorRGBA": "float32 r, float32 g, float32 b, float32 a",
        "sensor_msgs/msg/CompressedImage": "std_msgs/Header header, string format, uint8[] data",
        "visualization_msgs/msg/UVCoordinate": "float32 u, float32 v",
        "visualization_msgs/msg/MeshFile": "string filename, uint8[] data",
        "visualization_msgs/msg/Marker": "std_msgs/Header header, string ns, int32 id, int32 type, int32 action,"
        " geometry_msgs/Pose pose, geometry_msgs/Vector3 scale, std_msgs/ColorRGBA color,"
        " builtin_interfaces/Duration lifetime, bool frame_locked, geometry_msgs/Point[] points,"
        " std_msgs/ColorRGBA[] colors, string texture_resource, sensor_msgs/CompressedImage texture,"
        " visualization_msgs/UVCoordinate[] uv_coordinates, string text, string mesh_resource,"
        " visualization_msgs/MeshFile mesh_file, bool mesh_use_embedded_materials",
        MARKER_ARRAY: "visualization_msgs/Marker[] markers",
        "diagnostic_msgs/msg/KeyValue": "string key, string value",
        "diagnostic_msgs/msg/DiagnosticStatus": "byte level, string name, string message, string hardware_id,"
        " diagnostic_msgs/KeyValue[] values",
        DIAGNOSTIC_ARRAY: "std_msgs/Header header, diagnostic_msgs/DiagnosticStatus[] status",
    }
)
"""Fields by type: `.msg` files without comments and default values, a comma for the end of a line."""

TYPE_IDS = MappingProxyType(
    {"bool": 15, "byte": 16, "float32": 10, "float64": 11, "int32": 6, "string": 17, "uint8": 3, "uint32": 7}
)
"""Numbers of the basic types in type_description_interfaces/msg/FieldType."""

_NESTED_ID, _ARRAY_IDS, _SEQUENCE_IDS = 1, 48, 144

SEQUENCE = 0
"""The `length` of a field with any number of values."""

_FIELD = re.compile(r"(?P<type>[\w/]+)(?P<many>\[(?P<count>\d*)\])? (?P<name>\w+)")


class MessageField(NamedTuple):
    """A field. `type` is a basic type or a message's full name; `length` is None for a single value."""

    name: str
    type: str
    length: int | None


@lru_cache
def fields_of(message_type: str) -> tuple[MessageField, ...]:
    """Parse a definition.

    Raises:
        KeyError: the type is not one of `DEFINITIONS`.
    """
    fields = []
    for line in DEFINITIONS[message_type].split(", "):
        found = _FIELD.fullmatch(line.strip())
        assert found, line
        name = found["type"] if found["type"] in TYPE_IDS else found["type"].replace("/", "/msg/")
        fields.append(MessageField(found["name"], name, int(found["count"] or SEQUENCE) if found["many"] else None))
    return tuple(fields)


@lru_cache
def type_hash(message_type: str) -> str:
    """Compute the RIHS01 hash of a type."""
    import hashlib  # brings OpenSSL, which a board without ROS does without

    described = {
        "type_description": _description(message_type),
        "referenced_type_descriptions": [_description(name) for name in sorted(_references(message_type))],
    }
    return f"RIHS01_{hashlib.sha256(json.dumps(described).encode()).hexdigest()}"


def _references(message_type: str) -> set[str]:
    direct = {field.type for field in fields_of(message_type) if field.type in DEFINITIONS}
    return direct.union(*map(_references, direct))


def _description(message_type: str) -> dict[str, Any]:
    fields = [{"name": field.name, "type": _field_type(field)} for field in fields_of(message_type)]
    return {"type_name": message_type, "fields": fields}


def _field_type(field: MessageField) -> dict[str, Any]:
    is_basic = field.type in TYPE_IDS
    offset = 0 if field.length is None else _ARRAY_IDS if field.length else _SEQUENCE_IDS
    return {
        "type_id": offset + (TYPE_IDS[field.type] if is_basic else _NESTED_ID),
        "capacity": field.length or 0,
        "string_capacity": 0,
        "nested_type_name": "" if is_basic else field.type,
    }
