"""The messages between the world and its agents: frame and act, with the sample of the radio in a frame.

Both cross the fabric once per agent and step, so they are MessagePack arrays. What the operator, tools and
people read is in `operator_messages.py`.
"""

from itertools import chain
from typing import Any, NamedTuple

from deltaswarm_wire.codec import (
    MAX_ABS_M,
    MAX_AGENT_ID,
    MAX_ID,
    MAX_RADIO_BYTES,
    MAX_SAMPLE_BYTES,
    MAX_STEP,
    PROTOCOL_VERSION,
    WireError,
    array,
    arrays,
    boolean,
    integer,
    number,
    octets,
    pack,
    text,
    tuple_of,
    unpack,
    version,
)

MAX_SENSED = 1000
MAX_HEARD = 4096
"""More than fit with the smallest radio frames: the size in bytes is the real limit."""
MAX_SPEED_MPS = 1000.0
MAX_TIME_S = 1e9
MAX_ROLE = 16
"""Characters."""
MAX_METRICS = 16
MAX_METRIC_NAME = 32
"""Characters of the name of a controller's own number, which becomes part of the names of columns."""
METRIC_LIMIT = 1e300
ACT_ITEMS = 11
"""Items of an act without a controller's own numbers."""
MAX_POSES = 64
"""Longest interval between two frames of an agent [steps]: a frame holds every position since the last."""

FRAME_ROOM_BYTES = MAX_SAMPLE_BYTES - 2048
"""Room in a frame for sensed events and heard frames; the rest is for its header."""

SENSED_BYTES = 24
"""Upper bound of one sensed event in a frame."""


class Event(NamedTuple):
    """An event within sensing range. Place in m, world frame."""

    event: int
    x_m: float
    y_m: float


Pose = tuple[float, float]
"""Position of an agent: x and y [m; world frame]."""

Heard = tuple[int, bytes]
"""A received radio frame: its sender and the sender's sample, unchanged."""


class Frame(NamedTuple):
    """What one agent senses and hears in one step. After a frame with `last`, it acts once more and exits.

    `poses` are its positions in the steps since its last frame, oldest first; empty if that was in the previous step.
    `bumped` and `blocked` are what a body feels that takes up room: whether it touched another one or a wall in the
    last step, and whether something kept it from moving as its act said.
    """

    step: int
    time_s: float
    last: bool
    x_m: float
    y_m: float
    poses: tuple[Pose, ...]
    events: tuple[Event, ...]
    heard: tuple[Heard, ...]
    bumped: bool = False
    blocked: bool = False


def encode_frame(frame: Frame) -> bytes:
    """`[version, step, time_s, last, x_m, y_m, [x_m, y_m...], [[event, x_m, y_m]...], [sender, sample...]]`.

    With `bumped` or `blocked`, both follow.
    """
    step, time_s, last, x_m, y_m, poses, events, heard, bumped, blocked = frame
    flat = chain.from_iterable
    walked = tuple(flat(poses)) if poses else ()
    felt = (bumped, blocked) if bumped or blocked else ()
    return pack((PROTOCOL_VERSION, step, time_s, last, x_m, y_m, walked, events, tuple(flat(heard)), *felt))


def decode_frame(data: bytes) -> Frame:
    """Check and decode. Raises WireError."""
    items = unpack(data)
    felt = (False, False)
    if isinstance(items, list) and len(items) == 11:
        felt = boolean(items[9], "frame.bumped"), boolean(items[10], "frame.blocked")
        items = items[:9]
    known, step, time_s, last, x_m, y_m, poses, events, heard = array(items, 9, "frame")
    version(known)
    return Frame(
        integer(step, 0, MAX_STEP, "frame.step"),
        number(time_s, 0.0, MAX_TIME_S, "frame.time_s"),
        boolean(last, "frame.last"),
        number(x_m, -MAX_ABS_M, MAX_ABS_M, "frame.x_m"),
        number(y_m, -MAX_ABS_M, MAX_ABS_M, "frame.y_m"),
        _poses(poses),
        read_events(events, MAX_SENSED, "frame.events"),
        _heard(heard),
        *felt,
    )


def _poses(raw: Any) -> tuple[Pose, ...]:
    flat = arrays(raw, 2 * MAX_POSES, "frame.poses")
    for value in flat:
        number(value, -MAX_ABS_M, MAX_ABS_M, "frame.poses")
    return _pairs(flat, "frame.poses")


def _heard(raw: Any) -> tuple[Heard, ...]:
    heard = _pairs(arrays(raw, 2 * MAX_HEARD, "frame.heard"), "frame.heard")
    for sender, sample in heard:
        integer(sender, 0, MAX_AGENT_ID, "frame.heard")
        octets(sample, MAX_RADIO_BYTES, "frame.heard")
    return heard


def _pairs(flat: list[Any], field: str) -> tuple[tuple[Any, Any], ...]:
    if len(flat) % 2:
        raise WireError(field, "have an even number of items", len(flat))
    return tuple(zip(flat[::2], flat[1::2], strict=True))


def read_events(raw: Any, limit: int, field: str) -> tuple[Event, ...]:
    """Check and decode an array of at most `limit` events. Raises WireError."""
    rows = arrays(raw, limit, field)
    return tuple([_event(row, field) for row in rows]) if rows else ()


def _event(row: Any, field: str) -> Event:
    array(row, 3, field)
    return Event(
        integer(row[0], 0, MAX_ID, field),
        number(row[1], -MAX_ABS_M, MAX_ABS_M, field),
        number(row[2], -MAX_ABS_M, MAX_ABS_M, field),
    )


NOBODY = -1
"""Stands for "no agent" where an id is expected."""

MAX_DELTA = 1_000_000

FREE = "free"
"""The role of an agent outside every tree."""


class TreeStatus(NamedTuple):
    """An agent's own account of its role and its place in a tree.

    `root` is the root of its tree (its own id if it is the root), NOBODY outside a tree. `level` is the number of
    agents above it, `parent` the next agent above it or NOBODY. `delta` is the number of events sensed at once that
    would make it a root now; 0 if it has no such number.
    """

    role: str = FREE
    level: int = 0
    parent: int = NOBODY
    root: int = NOBODY
    delta: int = 0


class Act(NamedTuple):
    """What an agent does from a step on: velocity [m/s; world frame], observed events, and its place in a tree.

    It holds until the step `until`, in which the agent gets its next frame. Sensing or hearing something brings the
    next frame earlier.
    """

    step: int
    vx_mps: float
    vy_mps: float
    observed: tuple[int, ...]
    tree_status: TreeStatus
    until: int
    metrics: tuple[tuple[str, float], ...] = ()
    """The controller's own numbers, by name."""


def encode_act(act: Act) -> bytes:
    """`[version, step, vx_mps, vy_mps, [event...], role, level, parent, root, delta, until]`, and `metrics` if any."""
    step, vx_mps, vy_mps, observed, tree_status, until, metrics = act
    fields = (PROTOCOL_VERSION, step, vx_mps, vy_mps, observed, *tree_status, until)
    return pack((*fields, dict(metrics)) if metrics else fields)


def decode_act(data: bytes) -> Act:
    """Check and decode. Raises WireError."""
    raw = unpack(data)
    metrics: Any = raw.pop() if type(raw) is list and len(raw) == ACT_ITEMS + 1 else ()
    known, step, vx_mps, vy_mps, observed, role, level, parent, root, delta, until = array(raw, ACT_ITEMS, "act")
    version(known)
    status = (
        role_name(role, "act.role"),
        integer(level, 0, MAX_AGENT_ID, "act.level"),
        integer(parent, NOBODY, MAX_AGENT_ID, "act.parent"),
        integer(root, NOBODY, MAX_AGENT_ID, "act.root"),
        integer(delta, 0, MAX_DELTA, "act.delta"),
    )
    fields = (
        integer(step, 0, MAX_STEP, "act.step"),
        number(vx_mps, -MAX_SPEED_MPS, MAX_SPEED_MPS, "act.vx_mps"),
        number(vy_mps, -MAX_SPEED_MPS, MAX_SPEED_MPS, "act.vy_mps"),
        _observed(observed),
        tuple_of(TreeStatus, status),
        integer(until, step + 1, MAX_STEP + 1, "act.until"),
        () if metrics == () else _metrics(metrics),
    )
    act: Act = tuple_of(Act, fields)
    return act


def _metrics(raw: Any) -> tuple[tuple[str, float], ...]:
    if not isinstance(raw, dict) or not 0 < len(raw) <= MAX_METRICS:
        raise WireError("act.metrics", f"be a map of 1 to {MAX_METRICS} numbers", type(raw).__name__)
    return tuple(
        [
            (text(name, "act.metrics", MAX_METRIC_NAME), number(value, -METRIC_LIMIT, METRIC_LIMIT, "act.metrics"))
            for name, value in raw.items()
        ]
    )


def role_name(value: Any, field: str) -> str:
    """Check a role: 1 to `MAX_ROLE` printable ASCII characters."""
    role = text(value, field, MAX_ROLE)
    if not (role and role.isascii() and role.isprintable()):
        raise WireError(field, "be printable ASCII characters", repr(role))
    return role


def _observed(raw: Any) -> tuple[int, ...]:
    events = arrays(raw, MAX_SENSED, "act.observed")
    for event in events:
        integer(event, 0, MAX_ID, "act.observed")
    return tuple(events)
