"""ROS 2's messages that deltaswarm exchanges, as their packages define them, and the type hashes of its topics."""

import re
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

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

BASIC = frozenset(("bool", "byte", "float32", "float64", "int32", "string", "uint8", "uint32"))

HASHES = MappingProxyType(
    {
        TWIST: "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
        TWIST_STAMPED: "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
        POSE_STAMPED: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
        POSE_ARRAY: "RIHS01_af0cc36d190e104d546d168d6b39df04fa4b4ccecf59cb4c9ed328d3d5004aa0",
        ODOMETRY: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
        CLOCK: "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
        MARKER_ARRAY: "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
        DIAGNOSTIC_ARRAY: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
        "std_msgs/msg/String": "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    }
)
"""The type hash (RIHS01) of each topic's definition, the same from ROS 2 Iron on."""

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
    """Parse a definition."""
    fields = []
    for line in DEFINITIONS[message_type].split(", "):
        found = _FIELD.fullmatch(line.strip())
        assert found, line
        name = found["type"] if found["type"] in BASIC else found["type"].replace("/", "/msg/")
        fields.append(MessageField(found["name"], name, int(found["count"] or SEQUENCE) if found["many"] else None))
    return tuple(fields)
