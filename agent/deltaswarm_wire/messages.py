"""What travels besides radio frames: frame, act, report (also forwarded), health, clock, workload, status.

Frame and act cross the fabric once per agent and step, so they are MessagePack arrays. Report, health,
clock, workload and status are few and read by tools and people, so they are maps with named fields.
"""

from functools import lru_cache
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
    fields,
    integer,
    number,
    pack,
    text,
    unpack,
    version,
)

MAX_SENSED = 1000
MAX_HEARD = 4096
"""More than the smallest radio frames could fill: the bound on a frame is its bytes."""
MAX_SPEED_MPS = 1000.0
MAX_TIME_S = 1e9
MAX_REPORTED = 64
MAX_ROLE = 16
"""Characters."""
MAX_POSES = 64
"""An agent is asked at least this often [steps], so that a frame holds all places since the last."""

FRAME_ROOM_BYTES = MAX_SAMPLE_BYTES - 2048
"""What a frame may hold of sensed events and heard frames; the rest is for its head."""

SENSED_BYTES = 24
"""Upper bound of one sensed event in a frame."""


class Event(NamedTuple):
    """An event within sensing range. Place in m, world frame."""

    event: int
    x_m: float
    y_m: float


Pose = tuple[float, float]
"""Where an agent is: x and y [m; world frame]."""

Heard = tuple[int, bytes]
"""A radio frame as it is heard: its sender, and the sample as the sender made it."""


class Frame(NamedTuple):
    """What one agent senses and hears in one step. `last` tells it to act once more and end.

    `poses` are its places in the steps since its last frame, oldest first: none, if it was asked in the step before.
    """

    step: int
    time_s: float
    last: bool
    x_m: float
    y_m: float
    poses: tuple[Pose, ...]
    events: tuple[Event, ...]
    heard: tuple[Heard, ...]


def encode_frame(frame: Frame) -> bytes:
    """`[version, step, time_s, last, x_m, y_m, [x_m, y_m...], [[event, x_m, y_m]...], [sender, sample...]]`."""
    step, time_s, last, x_m, y_m, poses, events, heard = frame
    flat = chain.from_iterable
    return pack((PROTOCOL_VERSION, step, time_s, last, x_m, y_m, tuple(flat(poses)), events, tuple(flat(heard))))


def decode_frame(data: bytes) -> Frame:
    """Check and decode. Raises WireError."""
    known, step, time_s, last, x_m, y_m, poses, events, heard = array(unpack(data), 9, "frame")
    version(known)
    return Frame(
        integer(step, 0, MAX_STEP, "frame.step"),
        number(time_s, 0.0, MAX_TIME_S, "frame.time_s"),
        boolean(last, "frame.last"),
        number(x_m, -MAX_ABS_M, MAX_ABS_M, "frame.x_m"),
        number(y_m, -MAX_ABS_M, MAX_ABS_M, "frame.y_m"),
        _poses(poses),
        _events(events, MAX_SENSED, "frame.events"),
        _heard(heard),
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
        if type(sample) is not bytes or len(sample) > MAX_RADIO_BYTES:
            raise WireError("frame.heard", f"bytes are expected, at most {MAX_RADIO_BYTES}")
    return heard


def _pairs(flat: list[Any], field: str) -> tuple[tuple[Any, Any], ...]:
    if len(flat) % 2:
        raise WireError(field, f"{len(flat)} items, an even number is expected")
    return tuple(zip(flat[::2], flat[1::2], strict=True))


def _events(raw: Any, limit: int, field: str) -> tuple[Event, ...]:
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
"""In place of an agent's id, where there is none."""

FREE = "free"
"""The role of an agent that belongs to nothing and has nothing to say."""


class Standing(NamedTuple):
    """What an agent says it is: a role to be shown, and its place in a tree.

    `root` is its tree's root, and its own id if it is one; NOBODY outside a tree. `level` is the number of agents above
    it, `parent` the one right above it, or NOBODY.
    """

    role: str = FREE
    level: int = 0
    parent: int = NOBODY
    root: int = NOBODY


class Act(NamedTuple):
    """What an agent does from one step on: a velocity [m/s; world frame], the events it observes, what it is.

    It holds until the step `until`, in which the agent is asked again; earlier, if it senses or hears something.
    """

    step: int
    vx_mps: float
    vy_mps: float
    observed: tuple[int, ...]
    standing: Standing
    until: int


def encode_act(act: Act) -> bytes:
    """`[version, step, vx_mps, vy_mps, [event...], role, level, parent, root, until]`."""
    step, vx_mps, vy_mps, observed, standing, until = act
    return pack((PROTOCOL_VERSION, step, vx_mps, vy_mps, observed, *standing, until))


def decode_act(data: bytes) -> Act:
    """Check and decode. Raises WireError."""
    known, step, vx_mps, vy_mps, observed, role, level, parent, root, until = array(unpack(data), 10, "act")
    version(known)
    return Act(
        integer(step, 0, MAX_STEP, "act.step"),
        number(vx_mps, -MAX_SPEED_MPS, MAX_SPEED_MPS, "act.vx_mps"),
        number(vy_mps, -MAX_SPEED_MPS, MAX_SPEED_MPS, "act.vy_mps"),
        _observed(observed),
        Standing(
            role_name(role, "act.role"),
            integer(level, 0, MAX_AGENT_ID, "act.level"),
            integer(parent, NOBODY, MAX_AGENT_ID, "act.parent"),
            integer(root, NOBODY, MAX_AGENT_ID, "act.root"),
        ),
        integer(until, step + 1, MAX_STEP + 1, "act.until"),
    )


def role_name(value: Any, field: str) -> str:
    """A role: one to `MAX_ROLE` printable ASCII characters."""
    role = text(value, field, MAX_ROLE)
    if not (role and role.isascii() and role.isprintable()):
        raise WireError(field, "printable ASCII characters are expected")
    return role


def _observed(raw: Any) -> tuple[int, ...]:
    events = arrays(raw, MAX_SENSED, "act.observed")
    for event in events:
        integer(event, 0, MAX_ID, "act.observed")
    return tuple(events)


class Report(NamedTuple):
    """One message for the human operator.

    Under the paper's control a free agent reports the event that it observes; a root what its tree knows of.
    """

    agent: int
    sequence: int
    step: int
    role: str
    x_m: float
    y_m: float
    followers: int
    events: tuple[Event, ...]


_REPORT_FIELDS = ("agent", "sequence", "step", "role", "x_m", "y_m", "followers", "events")


def encode_report(report: Report) -> bytes:
    """A map with the fields of `Report` and the version `v`."""
    return pack({"v": PROTOCOL_VERSION, **report._asdict()})


@lru_cache(maxsize=128)  # in one process the agent's shell and the operator decode the same
def decode_report(data: bytes) -> Report:
    """Check and decode. Raises WireError."""
    raw = fields(unpack(data), _REPORT_FIELDS, "report")
    return Report(
        integer(raw["agent"], 0, MAX_AGENT_ID, "report.agent"),
        integer(raw["sequence"], 0, MAX_STEP, "report.sequence"),
        integer(raw["step"], 0, MAX_STEP, "report.step"),
        role_name(raw["role"], "report.role"),
        number(raw["x_m"], -MAX_ABS_M, MAX_ABS_M, "report.x_m"),
        number(raw["y_m"], -MAX_ABS_M, MAX_ABS_M, "report.y_m"),
        integer(raw["followers"], 0, MAX_AGENT_ID, "report.followers"),
        _events(raw["events"], MAX_REPORTED, "report.events"),
    )


class Forwarded(NamedTuple):
    """A report that came through the uplink in a step, as the world hands it to the operator.

    The sequence is the world's own, so that what the fabric loses is told from what the uplink does.
    """

    sequence: int
    step: int
    report: bytes


def encode_forwarded(forwarded: Forwarded) -> bytes:
    """`[version, sequence, step, report as its agent encoded it]`."""
    return pack((PROTOCOL_VERSION, *forwarded))


def decode_forwarded(data: bytes) -> Forwarded:
    """Check and decode; the report in it is checked by who decodes that. Raises WireError."""
    known, sequence, step, report = array(unpack(data), 4, "forwarded")
    version(known)
    if type(report) is not bytes:
        raise WireError("forwarded.report", "bytes are expected")
    return Forwarded(
        integer(sequence, 0, MAX_ID, "forwarded.sequence"), integer(step, 0, MAX_STEP, "forwarded.step"), report
    )


class Health(NamedTuple):
    """How an agent's body is, in open air: `fault` says in a few words what is wrong, and nothing if it is well."""

    fault: str


MAX_FAULT = 200
"""Characters."""


def encode_health(health: Health) -> bytes:
    """A map with the field of `Health`, as one line of `MAX_FAULT` characters, and the version `v`."""
    fault = "".join(character if character.isprintable() else " " for character in health.fault[:MAX_FAULT])
    return pack({"v": PROTOCOL_VERSION, "fault": fault})


def decode_health(data: bytes) -> Health:
    """Check and decode. Raises WireError."""
    fault = text(fields(unpack(data), Health._fields, "health")["fault"], "health.fault", MAX_FAULT)
    if not fault.isprintable():
        raise WireError("health.fault", "printable characters are allowed")
    return Health(fault)


class Clock(NamedTuple):
    """Step `step` is closed: whatever was sent in it has been forwarded before this."""

    step: int
    time_s: float
    last: bool


_CLOCK_FIELDS = Clock._fields


def encode_clock(clock: Clock) -> bytes:
    """A map with the fields of `Clock` and the version `v`."""
    return pack({"v": PROTOCOL_VERSION, **clock._asdict()})


def decode_clock(data: bytes) -> Clock:
    """Check and decode. Raises WireError."""
    raw = fields(unpack(data), _CLOCK_FIELDS, "clock")
    return Clock(
        integer(raw["step"], 0, MAX_STEP, "clock.step"),
        number(raw["time_s"], 0.0, MAX_TIME_S, "clock.time_s"),
        boolean(raw["last"], "clock.last"),
    )


class Workload(NamedTuple):
    """What the operator counted in one closed step; rates are over simulated time."""

    step: int
    time_s: float
    messages: int
    senders: int
    rate_1s_hz: float
    rate_60s_hz: float
    time_above_s: float
    backlog: int
    lost: int
    rejected: int


_WORKLOAD_COUNTS = ("messages", "senders", "backlog", "lost", "rejected")


def encode_workload(workload: Workload) -> bytes:
    """A map with the fields of `Workload` and the version `v`."""
    return pack({"v": PROTOCOL_VERSION, **workload._asdict()})


def decode_workload(data: bytes) -> Workload:
    """Check and decode. Raises WireError."""
    raw = fields(unpack(data), Workload._fields, "workload")
    counts = {name: integer(raw[name], 0, MAX_ID, f"workload.{name}") for name in _WORKLOAD_COUNTS}
    return Workload(
        step=integer(raw["step"], 0, MAX_STEP, "workload.step"),
        time_s=number(raw["time_s"], 0.0, MAX_TIME_S, "workload.time_s"),
        rate_1s_hz=number(raw["rate_1s_hz"], 0.0, MAX_ID, "workload.rate_1s_hz"),
        rate_60s_hz=number(raw["rate_60s_hz"], 0.0, MAX_ID, "workload.rate_60s_hz"),
        time_above_s=number(raw["time_above_s"], 0.0, MAX_TIME_S, "workload.time_above_s"),
        **counts,
    )


class Status(NamedTuple):
    """A sign of life of the world for people who wait: about once per wall second, never in a digest."""

    step: int
    steps: int
    time_s: float
    agents_alive: int
    agents_in_trees: int
    mean_waiting_s: float
    phase: str


STATUS_PHASES = ("waiting", "running", "ended")


def encode_status(status: Status) -> bytes:
    """A map with the fields of `Status` and the version `v`."""
    return pack({"v": PROTOCOL_VERSION, **status._asdict()})


def decode_status(data: bytes) -> Status:
    """Check and decode. Raises WireError."""
    raw = fields(unpack(data), Status._fields, "status")
    return Status(
        integer(raw["step"], 0, MAX_STEP, "status.step"),
        integer(raw["steps"], 0, MAX_STEP, "status.steps"),
        number(raw["time_s"], 0.0, MAX_TIME_S, "status.time_s"),
        integer(raw["agents_alive"], 0, MAX_AGENT_ID, "status.agents_alive"),
        integer(raw["agents_in_trees"], 0, MAX_AGENT_ID, "status.agents_in_trees"),
        number(raw["mean_waiting_s"], 0.0, MAX_TIME_S, "status.mean_waiting_s"),
        text(raw["phase"], "status.phase", allowed=STATUS_PHASES),
    )
