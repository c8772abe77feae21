"""The topics of a recording, and the protobuf message of each.

Viewers draw a topic by the name of its schema: Foxglove and Lichtblick the scene, Rerun the points. The
`foxglove` messages are the published ones; the `deltaswarm` messages are made here from the wire's named tuples.
"""

import typing
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

from deltaswarm_scenario.truth import BODY_FIELDS, COLUMNS, AgentState, EventState, StepRecord
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import Answer, Report, ReportedMember, Workload

ROOT_FRAME = "world"
"""The root frame. Its origin is the arena's centre, where a viewer's camera looks first."""

ARENA_FRAME = "arena"
"""The frame of all positions of agents and events: from (0, 0) to the arena's width and height."""

NET_FIELDS = COLUMNS[COLUMNS.index("frames_sent") :]
"""The columns of a record that `/net/stats` holds, besides the drops of radio models from outside."""

STATE_FIELDS = tuple(name for name in COLUMNS if name not in NET_FIELDS and name not in ("step", "time_s"))
"""The columns of a record that `/swarm/state` holds: all the others."""

AGENT_FIELDS = tuple(name for name in AgentState._fields[:8] if name not in ("x_m", "y_m"))
"""The fields of a body that `/swarm/agents` holds, sent when one changes; its position and attitude are in `/tf`."""


class Drops(NamedTuple):
    """The drops of a radio model from outside in one step."""

    reason: str
    frames: int


def _hints(row: Any, names: Iterable[str]) -> dict[str, Any]:
    hints = typing.get_type_hints(row)
    return {name: hints[name] for name in names}


_HEAD: dict[str, Any] = {"step": int, "time_s": float}

_MESSAGES: dict[str, Mapping[str, Any]] = {
    "NetStats": {**_HEAD, **dict.fromkeys(NET_FIELDS, int), "other_drops": list[Drops]},
    "Drops": _hints(Drops, Drops._fields),
    "SwarmState": {**_HEAD, **_hints(StepRecord, STATE_FIELDS), "wall_s": float},
    "Agents": {
        **_HEAD,
        **{name: list[hint] for name, hint in _hints(AgentState, AGENT_FIELDS).items()},  # type: ignore[valid-type]
        **dict.fromkeys(BODY_FIELDS, list[float]),  # empty for points
    },
    "Event": _hints(EventState, EventState._fields),
    "Sighting": _hints(Event, Event._fields),
    "Member": _hints(ReportedMember, ReportedMember._fields),
    "Answer": _hints(Answer, Answer._fields),
    "Report": _hints(Report, Report._fields),
    "Inbox": {**_HEAD, "count": int, "reports": list[Report]},
    "Workload": _hints(Workload, Workload._fields),
}
"""Our own messages, and the type of each field. In `Agents` each field has one entry per agent."""

_NESTED = {Drops: "Drops", Event: "Sighting", ReportedMember: "Member", Answer: "Answer", Report: "Report"}
_SIGNED = ("Agents", "Member")
"""Messages whose integers may be negative: NOBODY, and positions."""
_SCALARS = {int: FieldDescriptorProto.TYPE_UINT32, float: FieldDescriptorProto.TYPE_DOUBLE}
_SCALARS[str] = FieldDescriptorProto.TYPE_STRING


def _compiled() -> dict[str, Any]:
    file = FileDescriptorProto(name="deltaswarm.proto", package="deltaswarm", syntax="proto3")
    for name, hints in _MESSAGES.items():
        message = file.message_type.add(name=name)
        for number, (field_name, hint) in enumerate(hints.items(), 1):
            field = message.field.add(name=field_name, number=number, label=FieldDescriptorProto.LABEL_OPTIONAL)
            if typing.get_origin(hint) in (list, tuple):
                hint = typing.get_args(hint)[0]
                field.label = FieldDescriptorProto.LABEL_REPEATED
            elif hint == float | None:  # absent where it is None
                hint = float
                field.proto3_optional, field.oneof_index = True, len(message.oneof_decl)
                message.oneof_decl.add(name=f"_{field_name}")
            if hint in _NESTED:
                field.type, field.type_name = FieldDescriptorProto.TYPE_MESSAGE, f".deltaswarm.{_NESTED[hint]}"
            elif hint is int and name in _SIGNED:
                field.type = FieldDescriptorProto.TYPE_SINT32
            else:
                field.type = _SCALARS[hint]
    pool = DescriptorPool()
    pool.Add(file)
    return {name: GetMessageClass(pool.FindMessageTypeByName(f"deltaswarm.{name}")) for name in _MESSAGES}


OURS = _compiled()
"""The classes of our own messages, by name."""

SCENE_TOPICS = ("/scene/agents", "/scene/tree", "/scene/links", "/scene/events")
"""Topics for viewers that draw shapes: Foxglove and Lichtblick."""

POINT_TOPICS = ("/points/agents", "/points/events")
"""Topics for viewers that draw only points: Rerun."""

VIEW_TOPICS = {
    "/tf": FrameTransforms,
    **dict.fromkeys(SCENE_TOPICS, SceneUpdate),
    **dict.fromkeys(POINT_TOPICS, PointCloud),
    "/swarm/agents": OURS["Agents"],
}
"""Topics that show where everything is, thinned if steps are short; topic to message class."""

FIGURE_TOPICS = {
    "/net/stats": OURS["NetStats"],
    "/swarm/state": OURS["SwarmState"],
    "/swarm/event": OURS["Event"],
    "/operator/inbox": OURS["Inbox"],
    "/operator/workload": OURS["Workload"],
    "/log": Log,
}
"""Topics with the numbers of a run, never thinned and never rounded; topic to message class."""

TOPICS: dict[str, Any] = {**VIEW_TOPICS, **FIGURE_TOPICS}
