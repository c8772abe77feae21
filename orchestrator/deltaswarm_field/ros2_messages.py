"""Messages for ROS tools: agents, trees and events as markers; swarm and workload as diagnostics.

Positions are in m, in the arena's frame. A marker replaces the one before with its name, so nothing is ever deleted.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from deltaswarm_orchestrator.recording.scene import role_colour
from deltaswarm_orchestrator.recording.schemas import ARENA_FRAME
from deltaswarm_scenario.truth import Truth
from deltaswarm_wire.messages import NOBODY
from deltaswarm_wire.operator_messages import Workload

LINE_LIST, SPHERE_LIST = 5, 7
"""Types of markers."""

OK, WARN = 0, 1
"""Levels of diagnostics."""

AGENT_M, EVENT_M, LINE_M = 0.014, 0.018, 0.003
"""Diameters and width as shares of the arena's longest side."""

EVENT_COLOUR, TREE_COLOUR = "#a0522d", "#0072b2"

Place = tuple[float, float, float]
Message = Mapping[str, Any]


def markers(truth: Truth, side_m: float, stamp: Message) -> Message:
    """Make a MarkerArray: a sphere for each agent in its role's colour, lines to parents, a sphere for each event."""
    places = {body.agent: (body.x_m, body.y_m, body.height_m or 0.0) for body in truth.bodies}
    events = [(event.x_m, event.y_m, 0.0) for event in truth.events if event.completed_s is None]
    lines = [
        place
        for body in truth.bodies
        if body.parent != NOBODY and body.parent in places
        for place in (places[body.agent], places[body.parent])
    ]
    header = {"stamp": stamp, "frame_id": ARENA_FRAME}
    made = (
        ("agents", SPHERE_LIST, AGENT_M, places.values(), [_colour(role_colour(body.role)) for body in truth.bodies]),
        ("tree", LINE_LIST, LINE_M, lines, [_colour(TREE_COLOUR)] * len(lines)),
        ("events", SPHERE_LIST, EVENT_M, events, [_colour(EVENT_COLOUR)] * len(events)),
    )
    return {"markers": [_marker(header, *row[:2], row[2] * side_m, *row[3:]) for row in made]}


def _marker(
    header: Message, name: str, kind: int, size_m: float, places: Iterable[Place], colours: list[Message]
) -> Message:
    return {
        "header": header,
        "ns": name,
        "type": kind,
        "pose": {"orientation": {"w": 1.0}},
        "scale": {"x": size_m, "y": size_m, "z": size_m},
        "color": {"a": 1.0},
        "points": [dict(zip("xyz", place, strict=True)) for place in places],
        "colors": colours,
    }


def _colour(code: str) -> Message:
    red, green, blue = (int(code[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return {"r": red, "g": green, "b": blue, "a": 1.0}


def diagnostics(truth: Truth, workload: Workload | None, threshold_hz: float, stamp: Message) -> Message:
    """Make a DiagnosticArray of the swarm, and of the operator's workload, which above its threshold is a warning."""
    record = truth.step_record
    status = [
        _status(
            "deltaswarm: swarm",
            OK,
            f"{record.agents_in_trees} of {record.agents_alive} agents in trees",
            {"step": truth.step, "time_s": truth.time_s, "agents": len(truth.bodies), "events": len(truth.events)},
        )
    ]
    if workload is not None:
        is_above = workload.rate_60s_hz > threshold_hz
        text = f"{workload.rate_60s_hz:.2f} messages per second over 60 s, threshold {threshold_hz:g}"
        counts = {name: value for name, value in workload._asdict().items() if name != "step"}
        status.append(_status("deltaswarm: operator's workload", WARN if is_above else OK, text, counts))
    return {"header": {"stamp": stamp}, "status": status}


def _status(name: str, level: int, text: str, values: Mapping[str, float]) -> Message:
    rows = [{"key": key, "value": f"{value:.15g}"} for key, value in values.items()]
    return {"level": level, "name": name, "message": text, "hardware_id": "deltaswarm", "values": rows}
