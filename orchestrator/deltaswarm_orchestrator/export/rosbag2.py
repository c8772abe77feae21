"""Export a ROS 2 bag, for `ros2 bag` and everything that reads one.

| topic | type | what |
| --- | --- | --- |
| `/swarm/<role>` | `geometry_msgs/msg/PoseArray` | the agents of a role, in the frame `arena` |
| `/events` | `geometry_msgs/msg/PoseArray` | the events that are not complete |
| `/operator/messages` | `std_msgs/msg/Float64` | reports that reached the operator in the step |
| `/operator/rate_60s_hz` | `std_msgs/msg/Float64` | the same over the last 60 s, per second |
"""

import re
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from deltaswarm_orchestrator.export.snapshots import Film
from deltaswarm_orchestrator.recording.scene import log_time_ns, quaternion
from deltaswarm_orchestrator.recording.schemas import ARENA_FRAME
from deltaswarm_scenario.truth import AgentState

UPRIGHT = 0.0, 0.0, 0.0, 1.0
POSES, NUMBER = "geometry_msgs/msg/PoseArray", "std_msgs/msg/Float64"

_TYPES = get_typestore(Stores.ROS2_HUMBLE)
_KINDS = _TYPES.types


def write(film: Film, out: Path) -> None:
    """Write a folder with the bag, stored as MCAP."""
    with Writer(out, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        bag = _Bag(writer)
        shown: set[str] = set()
        for view in film.snapshots():
            places: dict[str, list[Any]] = {role: [] for role in shown}  # one empty message after the last agent left
            for body in view.bodies:
                places.setdefault(body.role, []).append(_pose_of(body))
            shown = {role for role, points in places.items() if points}
            for role in sorted(places):
                bag.add(f"/swarm/{_ros_name(role)}", POSES, view.time_s, _poses(places[role], view.time_s))
            events = [((event.x_m, event.y_m, 0.0), UPRIGHT) for event in view.events]
            bag.add("/events", POSES, view.time_s, _poses(events, view.time_s))
        for workload in film.recording.workloads:
            for name in ("messages", "rate_60s_hz"):
                value = _KINDS[NUMBER](data=float(getattr(workload, name)))
                bag.add(f"/operator/{name}", NUMBER, workload.time_s, value)


class _Bag:
    """Writes messages, and adds each topic with its first message."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._connections: dict[str, Any] = {}

    def add(self, topic: str, kind: str, time_s: float, message: Any) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=_TYPES)
        self._writer.write(self._connections[topic], log_time_ns(time_s), _TYPES.serialize_cdr(message, kind))


def _ros_name(role: str) -> str:
    """Turn a role into part of a topic's name: letters, digits and `_`, not starting with a digit."""
    name = re.sub(r"\W", "_", role, flags=re.ASCII)
    return f"_{name}" if name[0].isdecimal() else name


def _pose_of(body: AgentState) -> tuple[tuple[float, ...], tuple[float, ...]]:
    turn = UPRIGHT if body.height_m is None else quaternion(body)
    return (body.x_m, body.y_m, body.height_m or 0.0), turn


def _poses(places: list[Any], time_s: float) -> Any:
    seconds, nanos = divmod(log_time_ns(time_s), 1_000_000_000)
    stamp = _KINDS["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanos)
    header = _KINDS["std_msgs/msg/Header"](stamp=stamp, frame_id=ARENA_FRAME)
    point, turn, pose = (_KINDS[f"geometry_msgs/msg/{name}"] for name in ("Point", "Quaternion", "Pose"))
    return _KINDS[POSES](header, [pose(point(*place), turn(*rotation)) for place, rotation in places])
