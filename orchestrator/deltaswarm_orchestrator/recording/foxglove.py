"""What a recording holds for viewers (Foxglove, Lichtblick): its topics, their JSON schemas, the layout.

The `foxglove.*` schemas have the names and the structure of the published ones, since a viewer draws a
topic by its schema's name. The `deltaswarm.*` schemas are ours. All are flat: a viewer's parser fails on
`$ref`, `anyOf`, nullable types and arrays of arrays, and then shows nothing of the file.
"""

import typing
from collections.abc import Iterable
from typing import Any

from deltaswarm_wire.messages import Event, Report, Workload
from deltaswarm_wire.truth import DROP_REASONS, UPLINK_REASONS, EventState, Tally

Json = dict[str, Any]

NOT_YET = -1
"""Stands for None in the figures: times and areas are never below 0, and a schema with null breaks viewers."""

NET_FIELDS = (
    "frames_sent",
    "bytes_sent",
    "frames_received",
    "frames_duplicated",
    "frames_in_flight",
    *(f"dropped_{reason}" for reason in DROP_REASONS),
    "reports_sent",
    "reports_arrived",
    "reports_in_flight",
    *(f"reports_dropped_{reason}" for reason in UPLINK_REASONS),
    "rejected",
    "transport_lost",
)
"""What of a tally goes to `/net/stats`."""

STATE_FIELDS = tuple(name for name in Tally._fields if name not in NET_FIELDS and name not in ("step", "time_s"))
"""What of a tally goes to `/swarm/state`: all the rest."""

VIEW_TOPICS = {
    "/tf": "foxglove.FrameTransforms",
    "/scene/agents": "foxglove.SceneUpdate",
    "/scene/tree": "foxglove.SceneUpdate",
    "/scene/links": "foxglove.SceneUpdate",
    "/scene/events": "foxglove.SceneUpdate",
}
"""What is there to be looked at, thinned where steps are short; topic to schema."""

FIGURE_TOPICS = {
    "/net/stats": "deltaswarm.NetStats",
    "/swarm/state": "deltaswarm.SwarmState",
    "/swarm/event": "deltaswarm.Event",
    "/operator/inbox": "deltaswarm.Inbox",
    "/operator/workload": "deltaswarm.Workload",
    "/log": "foxglove.Log",
}
"""What is there to be counted, never thinned and never rounded; topic to schema."""

ROOT_FRAME = "world"
"""The root frame has the arena's centre as its origin, where a viewer's camera looks first."""

ARENA_FRAME = "arena"
"""The frame of all places that agents and events have: from (0, 0) to the arena's width and height."""


# How schemas are built


def _object(title: str, properties: Json, **more: Any) -> Json:
    """An object of which every property is required."""
    return {"title": title, "type": "object", "properties": properties, "required": list(properties), **more}


def _list(items: Json) -> Json:
    return {"type": "array", "items": items}


def _numbers(title: str, names: Iterable[str]) -> Json:
    return _object(title, dict.fromkeys(names, NUMBER))


def _moment(title: str) -> Json:
    """A time or a duration; as published, without `required`."""
    seconds = {"type": "integer", "minimum": 0} if title == "time" else {"type": "integer"}
    nanoseconds = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
    return {"type": "object", "title": title, "properties": {"sec": seconds, "nsec": nanoseconds}}


def _choice(title: str, *names: str) -> Json:
    """An enumeration from 0. This form of `oneOf`, numbers with titles, is the one that viewers read."""
    return {"title": title, "oneOf": [{"title": name, "const": value} for value, name in enumerate(names)]}


def _fields(row: Any, names: Iterable[str]) -> Json:
    """Properties for fields of a named tuple of the wire; a field that may be None is NOT_YET then."""
    kinds = {int: INTEGER, float: NUMBER, float | None: NUMBER, str: STRING}
    hints = typing.get_type_hints(row)
    return {name: kinds[hints[name]] for name in names}


NUMBER: Json = {"type": "number"}
INTEGER: Json = {"type": "integer"}
COUNT: Json = {"type": "integer", "minimum": 0}
STRING: Json = {"type": "string"}
BOOLEAN: Json = {"type": "boolean"}


# The published schemas


def _scene_entity() -> Json:
    color, vector = _numbers("foxglove.Color", "rgba"), _numbers("foxglove.Vector3", "xyz")
    pose = _object("foxglove.Pose", {"position": vector, "orientation": _numbers("foxglove.Quaternion", "xyzw")})
    points = {"points": _list(_numbers("foxglove.Point3", "xyz")), "color": color, "colors": _list(color)}
    solid = {"pose": pose, "size": vector}
    arrow = {
        "pose": pose,
        "shaft_length": NUMBER,
        "shaft_diameter": NUMBER,
        "head_length": NUMBER,
        "head_diameter": NUMBER,
        "color": color,
    }
    line = {
        "type": _choice("foxglove.LineType", "LINE_STRIP", "LINE_LOOP", "LINE_LIST"),
        "pose": pose,
        "thickness": NUMBER,
        "scale_invariant": BOOLEAN,
        **points,
        "indices": _list(COUNT),
    }
    text = {
        "pose": pose,
        "billboard": BOOLEAN,
        "font_size": NUMBER,
        "scale_invariant": BOOLEAN,
        "color": color,
        "text": STRING,
    }
    model = {
        "pose": pose,
        "scale": vector,
        "color": color,
        "override_color": BOOLEAN,
        "url": STRING,
        "media_type": STRING,
        "data": {"type": "string", "contentEncoding": "base64"},
    }
    cylinder = {**solid, "bottom_scale": NUMBER, "top_scale": NUMBER, "color": color}
    return _object(
        "foxglove.SceneEntity",
        {
            "timestamp": _moment("time"),
            "frame_id": STRING,
            "id": STRING,
            "lifetime": _moment("duration"),
            "frame_locked": BOOLEAN,
            "metadata": _list(_object("foxglove.KeyValuePair", {"key": STRING, "value": STRING})),
            "arrows": _list(_object("foxglove.ArrowPrimitive", arrow)),
            "cubes": _list(_object("foxglove.CubePrimitive", {**solid, "color": color})),
            "spheres": _list(_object("foxglove.SpherePrimitive", {**solid, "color": color})),
            "cylinders": _list(_object("foxglove.CylinderPrimitive", cylinder)),
            "lines": _list(_object("foxglove.LinePrimitive", line)),
            "triangles": _list(
                _object("foxglove.TriangleListPrimitive", {"pose": pose, **points, "indices": _list(COUNT)})
            ),
            "texts": _list(_object("foxglove.TextPrimitive", text)),
            "models": _list(_object("foxglove.ModelPrimitive", model)),
        },
    )


def _scene_update() -> Json:
    kind = _choice("foxglove.SceneEntityDeletionType", "MATCHING_ID", "ALL")
    deletion = {"timestamp": _moment("time"), "type": kind, "id": STRING}
    return _object(
        "foxglove.SceneUpdate",
        {
            "deletions": _list(_object("foxglove.SceneEntityDeletion", deletion)),
            "entities": _list(_scene_entity()),
        },
    )


def _frame_transforms() -> Json:
    transform = {
        "timestamp": _moment("time"),
        "parent_frame_id": STRING,
        "child_frame_id": STRING,
        "translation": _numbers("foxglove.Vector3", "xyz"),
        "rotation": _numbers("foxglove.Quaternion", "xyzw"),
    }
    return _object("foxglove.FrameTransforms", {"transforms": _list(_object("foxglove.FrameTransform", transform))})


def _log() -> Json:
    return _object(
        "foxglove.Log",
        {
            "timestamp": _moment("time"),
            "level": _choice("foxglove.LogLevel", "UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"),
            "message": STRING,
            "name": STRING,
            "file": STRING,
            "line": COUNT,
        },
    )


# Our own schemas


def _ours() -> list[Json]:
    head = {"step": INTEGER, "time_s": NUMBER}
    event = _object("deltaswarm.Sighting", _fields(Event, Event._fields))
    report = {**_fields(Report, (name for name in Report._fields if name != "events")), "events": _list(event)}
    return [
        _object("deltaswarm.NetStats", {**head, **_fields(Tally, NET_FIELDS)}),
        _object(
            "deltaswarm.SwarmState",
            {**head, **_fields(Tally, STATE_FIELDS), "wall_s": NUMBER},
            description="covered_area_m2 is -1 in steps in which it is not measured; wall_s is since the start",
        ),
        _object(
            "deltaswarm.Event",
            _fields(EventState, EventState._fields),
            description="sensed_s and completed_s are -1 for what is not yet",
        ),
        _object("deltaswarm.Inbox", {**head, "count": COUNT, "reports": _list(_object("deltaswarm.Report", report))}),
        _object("deltaswarm.Workload", _fields(Workload, Workload._fields)),
    ]


SCHEMAS: dict[str, Json] = {
    schema["title"]: schema for schema in (_frame_transforms(), _scene_update(), _log(), *_ours())
}
"""Every schema of a recording by its name."""


# The layout


def layout(width_m: float, height_m: float) -> Json:
    """A viewer's layout for an arena: the scene from above, workload, trees, log.

    White, since events are black; with the camera far enough away to see the whole arena.
    """
    longest_m = max(width_m, height_m)
    distance_m = 1.4 * longest_m  # at 45 degrees of view this shows 1.16 times the longest side
    scene = {
        "cameraState": {
            "perspective": True,
            "distance": distance_m,
            "phi": 0,
            "thetaOffset": 0,
            "targetOffset": [0, 0, 0],
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.5,
            "far": max(5000, 4 * distance_m),
        },
        "followMode": "follow-pose",
        "followTf": ROOT_FRAME,
        "scene": {
            "backgroundColor": "#ffffff",
            "transforms": {"labelSize": longest_m / 80, "axisScale": longest_m / 100},
        },
        # a frame whose parent is hidden has no line drawn to it
        "transforms": {f"frame:{frame}": {"visible": False} for frame in (ROOT_FRAME, ARENA_FRAME)},
        "topics": {topic: {"visible": True} for topic in VIEW_TOPICS if topic != "/tf"},
        "layers": {
            "grid": {
                "layerId": "foxglove.Grid",
                "instanceId": "grid",
                "visible": True,
                "frameLocked": True,
                "label": "Grid",
                "frameId": ROOT_FRAME,
                "size": longest_m,
                "divisions": 10,
                "lineWidth": 1,
                "color": "#e4e4e4ff",
                "position": [0, 0, 0],
                "rotation": [0, 0, 0],
            }
        },
    }
    rates = ("/operator/workload.rate_1s_hz", "/operator/workload.rate_60s_hz")
    counts = ("/swarm/state.agents_in_trees", "/swarm/state.trees", "/swarm/state.events_active")
    return {
        "configById": {
            "3D!arena": scene,
            "Plot!workload": _plot("Reports to the operator [1/s]", rates),
            "Plot!trees": _plot("Agents in trees, trees, active events", counts),
            "RosOut!log": {"topicToRender": "/log", "minLogLevel": 1, "searchTerms": []},
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": "3D!arena",
            "second": {
                "direction": "column",
                "first": "Plot!workload",
                "second": {"direction": "column", "first": "Plot!trees", "second": "RosOut!log"},
                "splitPercentage": 36,
            },
            "splitPercentage": 60,
        },
    }


def _plot(title: str, paths: Iterable[str]) -> Json:
    return {
        **dict.fromkeys(("foxglovePanelTitle", "lichtblickPanelTitle"), title),
        "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
    }
