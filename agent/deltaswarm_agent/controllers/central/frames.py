"""What central control sends by radio: agents tell the planner what they sense, and it tells them where to go.

MessagePack arrays; positions in whole centimetres. A sensed frame is `[0, x, y, [event, x, y, ...]]`, with all events
that its sender senses; a plan is `[1, [agent, x, y, ...]]`, with the goal of each agent.
"""

from typing import NamedTuple

from deltaswarm_wire.codec import (
    MAX_ABS_CM,
    MAX_AGENT_ID,
    MAX_ID,
    MAX_RADIO_BYTES,
    WireError,
    array,
    arrays,
    integer,
    pack,
    unpack,
)
from deltaswarm_wire.messages import Event, Pose

SENSED, PLAN = 0, 1

MAX_EVENTS, MAX_GOALS = 256, 500
"""Further rows are not sent; they might not fit into a radio frame."""


class SensedFrame(NamedTuple):
    """Where the sender is [m], and all events that it senses."""

    pose: Pose
    events: tuple[Event, ...]


def encode_sensed(frame: SensedFrame) -> bytes:
    rows = [cell for event in frame.events[:MAX_EVENTS] for cell in (event.event, *_cm((event.x_m, event.y_m)))]
    return pack([SENSED, *_cm(frame.pose), rows], MAX_RADIO_BYTES)


def encode_plan(goals: dict[int, Pose]) -> bytes:
    rows = [cell for agent, goal in [*goals.items()][:MAX_GOALS] for cell in (agent, *_cm(goal))]
    return pack([PLAN, rows], MAX_RADIO_BYTES)


def decode_sensed(payload: bytes) -> SensedFrame:
    """Decode a sensed frame."""
    kind, x_cm, y_cm, rows = array(unpack(payload, MAX_RADIO_BYTES), 4, "sensed")
    integer(kind, SENSED, SENSED, "kind")
    events = [
        Event(integer(event, 0, MAX_ID, "event"), *_metres(x, y)) for event, x, y in _threes(rows, MAX_EVENTS, "events")
    ]
    return SensedFrame(_metres(x_cm, y_cm), tuple(events))


def decode_plan(payload: bytes) -> dict[int, Pose]:
    """Decode a plan: the goal of each agent [m]."""
    kind, rows = array(unpack(payload, MAX_RADIO_BYTES), 2, "plan")
    integer(kind, PLAN, PLAN, "kind")
    return {
        integer(agent, 0, MAX_AGENT_ID, "agent"): _metres(x, y) for agent, x, y in _threes(rows, MAX_GOALS, "goals")
    }


def _threes(rows: object, limit: int, field: str) -> list[tuple[object, object, object]]:
    flat = arrays(rows, 3 * limit, field)
    if len(flat) % 3:
        raise WireError(field, "have three items a row", len(flat))
    return list(zip(flat[::3], flat[1::3], flat[2::3], strict=True))


def _cm(pose: Pose) -> tuple[int, int]:
    return round(100.0 * pose[0]), round(100.0 * pose[1])


def _metres(x_cm: object, y_cm: object) -> Pose:
    low, high = -MAX_ABS_CM, MAX_ABS_CM
    return integer(x_cm, low, high, "x_cm") / 100, integer(y_cm, low, high, "y_cm") / 100
