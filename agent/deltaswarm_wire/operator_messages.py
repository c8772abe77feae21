"""The messages that the operator, tools and people read: report (also forwarded), health, clock, workload, status.

They are few, so all but a forwarded report are maps with named fields.
"""

from itertools import chain
from typing import Annotated, Any, NamedTuple

from deltaswarm_wire.codec import (
    MAX_ABS_CM,
    MAX_ABS_M,
    MAX_AGENT_ID,
    MAX_ID,
    MAX_SAMPLE_BYTES,
    MAX_STEP,
    PROTOCOL_VERSION,
    WireError,
    all_fit,
    array,
    arrays,
    fields,
    integer,
    keep,
    number,
    octets,
    pack,
    text,
    tuple_of,
    unpack,
    version,
)
from deltaswarm_wire.messages import MAX_DELTA, MAX_TIME_S, Event, read_events, role_name
from deltaswarm_wire.records import Limits, Record

MAX_REPORTED = 64
"""Events in one report."""
MAX_MEMBERS = 350
"""Followers that one report names."""
MAX_ANSWERS = 16
"""Commands that one report answers."""

HEARD, DONE, REFUSED, SUPERSEDED = 0, 1, 2, 3
"""State of a command at an agent: known, carried out, refused or not possible, or replaced by a later one."""


class ReportedMember(NamedTuple):
    """A member of the sender's tree: its parent, and its place [cm; world frame] as the sender last heard."""

    agent: int
    parent: int
    x_cm: int
    y_cm: int


class Answer(NamedTuple):
    """What an agent says of a command: `HEARD`, `DONE`, `REFUSED` or `SUPERSEDED`."""

    command: int
    state: int


class Report(NamedTuple):
    """One message for the human operator.

    With the paper's controllers, a free agent reports the event that it observes, a root the events known to its tree.
    """

    agent: int
    sequence: int
    step: int
    role: str
    x_m: float
    y_m: float
    followers: int
    events: tuple[Event, ...]
    members: tuple[ReportedMember, ...] = ()
    answers: tuple[Answer, ...] = ()
    delta: int = 0
    """See `TreeStatus`."""


_ROWS: dict[str, tuple[type[Any], int, str, tuple[tuple[int, int], ...]]] = {
    "members": (
        ReportedMember,
        MAX_MEMBERS,
        "HHii",
        ((0, MAX_AGENT_ID), (0, MAX_AGENT_ID), (-MAX_ABS_CM, MAX_ABS_CM), (-MAX_ABS_CM, MAX_ABS_CM)),
    ),
    "answers": (Answer, MAX_ANSWERS, "IB", ((0, MAX_ID), (HEARD, SUPERSEDED))),
}
"""Fields of rows in a flat array, which a report without any leaves out: rows, most of them, C types that their
items fit, and their bounds."""
_REPORT_FIELDS = tuple(name for name in Report._fields if name != "delta" and name not in _ROWS)


def encode_report(report: Report) -> bytes:
    """A map with the fields of `Report` and the version `v`. `members` and `answers` are flat, and absent if empty.

    So is `delta` if it is 0.
    """
    raw = {"v": PROTOCOL_VERSION, **dict(zip(_REPORT_FIELDS, report, strict=False))}
    if report.members:
        raw["members"] = tuple(chain.from_iterable(report.members))
    if report.answers:
        raw["answers"] = tuple(chain.from_iterable(report.answers))
    if report.delta:
        raw["delta"] = report.delta
    return pack(raw)


_KEPT = 128
_kept_reports: dict[bytes, Report] = {}
"""The newest reports by their bytes: in one process the agent's report need not be decoded at the operator's."""


def keep_report(data: bytes, report: Report) -> Report:
    """Keep a report that `decode_report` would make of these bytes, and return it."""
    return keep(_kept_reports, data, report, _KEPT)


def decode_report(data: bytes) -> Report:
    """Check and decode. Raises WireError."""
    kept = _kept_reports.get(data)
    return _decode_report(data) if kept is None else kept


def _decode_report(data: bytes) -> Report:
    raw = unpack(data)
    rows, delta = {}, 0
    if type(raw) is dict and len(raw) > len(_REPORT_FIELDS) + 1:
        rows = {name: _rows(raw.pop(name), name) for name in _ROWS if name in raw}
        delta = integer(raw.pop("delta", 0), 0, MAX_DELTA, "report.delta")
    raw = fields(raw, _REPORT_FIELDS, "report")
    report = Report(
        integer(raw["agent"], 0, MAX_AGENT_ID, "report.agent"),
        integer(raw["sequence"], 0, MAX_STEP, "report.sequence"),
        integer(raw["step"], 0, MAX_STEP, "report.step"),
        role_name(raw["role"], "report.role"),
        number(raw["x_m"], -MAX_ABS_M, MAX_ABS_M, "report.x_m"),
        number(raw["y_m"], -MAX_ABS_M, MAX_ABS_M, "report.y_m"),
        integer(raw["followers"], 0, MAX_AGENT_ID, "report.followers"),
        read_events(raw["events"], MAX_REPORTED, "report.events"),
        delta=delta,
        **rows,
    )
    return keep_report(data, report)


def read_own_report(data: bytes) -> Report:
    """Decode a report that this process made, as `decode_report` does, without its checks."""
    raw: dict[str, Any] = unpack(data)
    raw["events"] = tuple([tuple_of(Event, row) for row in raw["events"]])
    for name, (kind, _, _, bounds) in _ROWS.items():
        flat = iter(raw.get(name, ()))
        raw[name] = tuple([tuple_of(kind, row) for row in zip(*[flat] * len(bounds), strict=True)])
    raw.setdefault("delta", 0)
    report: Report = tuple_of(Report, [raw[name] for name in Report._fields])
    return report


def _rows(raw: Any, name: str) -> tuple[Any, ...]:
    kind, most, codes, bounds = _ROWS[name]
    width, field = len(bounds), f"report.{name}"
    flat = arrays(raw, most * width, field)
    if len(flat) % width:
        raise WireError(field, f"be rows of {width} items", f"{len(flat)} items")
    count = len(flat) // width
    if not all_fit(flat, codes * count) or name == "answers":
        for at, value in enumerate(flat):
            integer(value, *bounds[at % width], field)
    return tuple([tuple_of(kind, row) for row in zip(*[iter(flat)] * width, strict=True)])


class Forwarded(NamedTuple):
    """A report that passed the uplink in a step, as the world forwards it to the operator.

    `sequence` is the world's own count. It distinguishes losses on the fabric from losses on the uplink.
    """

    sequence: int
    step: int
    report: bytes


def encode_forwarded(forwarded: Forwarded) -> bytes:
    """`[version, sequence, step, report as its agent encoded it]`."""
    return pack((PROTOCOL_VERSION, *forwarded))


def decode_forwarded(data: bytes) -> Forwarded:
    """Check and decode all but the report inside. Raises WireError."""
    known, sequence, step, report = array(unpack(data), 4, "forwarded")
    version(known)
    return Forwarded(
        integer(sequence, 0, MAX_ID, "forwarded.sequence"),
        integer(step, 0, MAX_STEP, "forwarded.step"),
        octets(report, MAX_SAMPLE_BYTES, "forwarded.report"),
    )


class Health(NamedTuple):
    """Health of an agent's body in open air: `fault` is a short description, empty if the body is well."""

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
        raise WireError("health.fault", "be printable characters", repr(fault))
    return Health(fault)


_STEP = Limits("step", 0, MAX_STEP)
_TIME_S = Limits("simulated time [s]", 0.0, MAX_TIME_S)


class Clock(NamedTuple):
    """Step `step` is closed: everything sent in it has already been forwarded."""

    step: Annotated[int, _STEP]
    time_s: Annotated[float, _TIME_S]
    last: Annotated[bool, Limits("whether the run is over")]


CLOCK = Record(Clock, "clock")
encode_clock, decode_clock = CLOCK.encode, CLOCK.decode


class Workload(NamedTuple):
    """The operator's counts for one closed step; rates are per simulated second."""

    step: Annotated[int, _STEP]
    time_s: Annotated[float, _TIME_S]
    messages: Annotated[int, Limits("reports that arrived in the step", 0, MAX_ID)]
    senders: Annotated[int, Limits("agents that sent them", 0, MAX_ID)]
    rate_1s_hz: Annotated[float, Limits("rate of reports over 1 s [1/s]", 0.0, MAX_ID)]
    rate_60s_hz: Annotated[float, Limits("rate of reports over 60 s [1/s]", 0.0, MAX_ID)]
    time_above_s: Annotated[float, Limits("time in which the rate was above the threshold [s]", 0.0, MAX_TIME_S)]
    backlog: Annotated[int, Limits("samples that wait after the clock", 0, MAX_ID)]
    lost: Annotated[int, Limits("reports lost on the fabric in the step", 0, MAX_ID)]
    rejected: Annotated[int, Limits("samples rejected in the step", 0, MAX_ID)]


WORKLOAD = Record(Workload, "workload")
encode_workload, decode_workload = WORKLOAD.encode, WORKLOAD.decode

STATUS_PHASES = ("waiting", "running", "ended")


class Status(NamedTuple):
    """The world's progress for display: about once per wall second, never part of a digest."""

    step: Annotated[int, _STEP]
    steps: Annotated[int, Limits("steps of the whole run", 0, MAX_STEP)]
    time_s: Annotated[float, _TIME_S]
    agents_alive: Annotated[int, Limits("agents that are alive", 0, MAX_AGENT_ID)]
    agents_in_trees: Annotated[int, Limits("agents in a tree", 0, MAX_AGENT_ID)]
    mean_waiting_s: Annotated[float, Limits("mean waiting time of events [s]", 0.0, MAX_TIME_S)]
    events_open: Annotated[int, Limits("events that are not complete", 0, MAX_ID)]
    events_completed: Annotated[int, Limits("events completed since the start", 0, MAX_ID)]
    phase: Annotated[str, Limits("state of the run", choices=STATUS_PHASES)]


STATUS = Record(Status, "status")
encode_status, decode_status = STATUS.encode, STATUS.decode
