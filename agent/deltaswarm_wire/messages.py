"""What travels besides radio frames: frame, act, report (also forwarded), health, clock, workload, status.

Frame and act cross the fabric once per agent and step, so they are MessagePack arrays. Report, health,
clock, workload and status are few and read by tools and people, so they are maps with named fields.
"""

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

FRAME_ROOM_BYTES = MAX_SAMPLE_BYTES - 1024
"""What a frame may hold of sensed events and heard frames; the rest is for its head."""

SENSED_BYTES = 24
"""Upper bound of one sensed event in a frame."""


class Event(NamedTuple):
    """An event within sensing range. Place in m, world frame."""

    event: int
    x_m: float
    y_m: float


class Frame(NamedTuple):
    """What one agent senses and hears in one step. `last` tells it to act once more and end."""

    step: int
    time_s: float
    last: bool
    x_m: float
    y_m: float
    events: tuple[Event, ...]
    heard: tuple[bytes, ...]


def encode_frame(frame: Frame) -> bytes:
    """`[version, step, time_s, last, x_m, y_m, [[event, x_m, y_m]...], [radio frame...]]`."""
    return pack((PROTOCOL_VERSION, *frame))


def decode_frame(data: bytes) -> Frame:
    """Check and decode. Raises WireError."""
    raw = array(unpack(data), 8, "frame")
    known, step, time_s, last, x_m, y_m, events, heard = raw
    if (
        # Every agent does this in every step: a frame that is as it should be takes no further calls.
        type(known) is type(step) is int
        and type(time_s) is type(x_m) is type(y_m) is float
        and type(last) is bool
        and type(events) is type(heard) is list
        and known == PROTOCOL_VERSION
        and 0 <= step <= MAX_STEP
        and 0.0 <= time_s <= MAX_TIME_S
        and -MAX_ABS_M <= x_m <= MAX_ABS_M
        and -MAX_ABS_M <= y_m <= MAX_ABS_M
    ):
        return Frame(
            step,
            time_s,
            last,
            x_m,
            y_m,
            _events(events, MAX_SENSED, "frame.events") if events else (),
            _heard(heard) if heard else (),
        )
    version(known)
    return Frame(
        integer(raw[1], 0, MAX_STEP, "frame.step"),
        number(raw[2], 0.0, MAX_TIME_S, "frame.time_s"),
        boolean(raw[3], "frame.last"),
        number(raw[4], -MAX_ABS_M, MAX_ABS_M, "frame.x_m"),
        number(raw[5], -MAX_ABS_M, MAX_ABS_M, "frame.y_m"),
        _events(raw[6], MAX_SENSED, "frame.events"),
        _heard(raw[7]),
    )


def _heard(raw: Any) -> tuple[bytes, ...]:
    heard = arrays(raw, MAX_HEARD, "frame.heard")
    for item in heard:
        if type(item) is not bytes or len(item) > MAX_RADIO_BYTES:
            raise WireError("frame.heard", f"bytes are expected, at most {MAX_RADIO_BYTES}")
    return tuple(heard)


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


class Act(NamedTuple):
    """What an agent does in one step: a velocity [m/s; world frame] and the events it observes."""

    step: int
    vx_mps: float
    vy_mps: float
    observed: tuple[int, ...]


def encode_act(act: Act) -> bytes:
    """`[version, step, vx_mps, vy_mps, [event...]]`."""
    return pack((PROTOCOL_VERSION, *act))


def decode_act(data: bytes) -> Act:
    """Check and decode. Raises WireError."""
    raw = array(unpack(data), 5, "act")
    known, step, vx_mps, vy_mps, observed = raw
    if (
        # As for frames: the world does this for every agent in every step.
        type(known) is type(step) is int
        and type(vx_mps) is type(vy_mps) is float
        and observed == []
        and type(observed) is list
        and known == PROTOCOL_VERSION
        and 0 <= step <= MAX_STEP
        and -MAX_SPEED_MPS <= vx_mps <= MAX_SPEED_MPS
        and -MAX_SPEED_MPS <= vy_mps <= MAX_SPEED_MPS
    ):
        return Act(step, vx_mps, vy_mps, ())
    version(known)
    return Act(
        integer(raw[1], 0, MAX_STEP, "act.step"),
        number(raw[2], -MAX_SPEED_MPS, MAX_SPEED_MPS, "act.vx_mps"),
        number(raw[3], -MAX_SPEED_MPS, MAX_SPEED_MPS, "act.vy_mps"),
        _observed(raw[4]),
    )


def _observed(raw: Any) -> tuple[int, ...]:
    events = arrays(raw, MAX_SENSED, "act.observed")
    for event in events:
        integer(event, 0, MAX_ID, "act.observed")
    return tuple(events)


class Report(NamedTuple):
    """One message for the human operator.

    A free agent reports the event that it observes; a root reports what its tree knows of.
    """

    agent: int
    sequence: int
    step: int
    role: str
    x_m: float
    y_m: float
    followers: int
    events: tuple[Event, ...]


REPORT_ROLES = ("attending", "root")
_REPORT_FIELDS = ("agent", "sequence", "step", "role", "x_m", "y_m", "followers", "events")


def encode_report(report: Report) -> bytes:
    """A map with the fields of `Report` and the version `v`."""
    return pack({"v": PROTOCOL_VERSION, **report._asdict()})


def decode_report(data: bytes) -> Report:
    """Check and decode. Raises WireError."""
    raw = fields(unpack(data), _REPORT_FIELDS, "report")
    return Report(
        integer(raw["agent"], 0, MAX_AGENT_ID, "report.agent"),
        integer(raw["sequence"], 0, MAX_STEP, "report.sequence"),
        integer(raw["step"], 0, MAX_STEP, "report.step"),
        text(raw["role"], "report.role", allowed=REPORT_ROLES),
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
