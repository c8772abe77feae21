"""Truth: the world's full state in one step, for the recorder only.

It is a map with named fields. Its size grows with the swarm, so it uses an ordinary link.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple, Self

from deltaswarm_wire.codec import (
    MAX_ABS_M,
    MAX_AGENT_ID,
    MAX_ID,
    MAX_ORDINARY_BYTES,
    MAX_STEP,
    PROTOCOL_VERSION,
    WireError,
    array,
    arrays,
    fields,
    integer,
    number,
    octets,
    pack,
    unpack,
)
from deltaswarm_wire.controller_metrics import PREFIX
from deltaswarm_wire.digest import REPORT
from deltaswarm_wire.messages import MAX_DELTA, MAX_TIME_S, METRIC_LIMIT, NOBODY, role_name
from deltaswarm_wire.plugins import RADIO_MODELS
from deltaswarm_wire.records import Limits, Record

DEAD = "dead"
"""The role of an absent agent."""

AIR_REASONS = {
    "range": "it was too far away, or the power too low",
    "bandwidth": "the queue at the sender or the receiver was full",
    "frame_full": "the world's frame to the receiver was full",
    "dead": "a process is gone or hangs, or a radio is dead",
}
"""Why a frame did not reach a receiver, besides the reasons of the radio models."""

DROP_REASONS = ("range", *RADIO_MODELS.shipped, "bandwidth", "frame_full", "dead")
"""Why a frame did not reach a receiver: the first cause that applied."""

UPLINK_REASONS = {
    "outage": "no report gets through at this time",
    "range": "the sender was too far from the base, and no tree relayed it",
    "loss": "chance, at any hop",
    "burst": "chance, on a link in its bad state",
    "bandwidth": "the queue at the sender or a relay was full",
    "base_full": "the queue at the operator's radio was full",
    "expired": "it was relayed for too long",
    "left": "the relay left the tree",
    "dead": "the sender or a relay is gone or hangs, or its radio is dead",
}
"""Why a report did not reach the operator: the first cause that applied."""


_Id = Annotated[int, Limits("an event, or a count", 0, MAX_ID)]
_Agent = Annotated[int, Limits("an agent, or how many", 0, MAX_AGENT_ID)]
_AgentOrNobody = Annotated[int, Limits("an agent, or NOBODY", NOBODY, MAX_AGENT_ID)]
_Step = Annotated[int, Limits("a step", 0, MAX_STEP)]
_Metres = Annotated[float, Limits("a coordinate [m]", -MAX_ABS_M, MAX_ABS_M)]
_Seconds = Annotated[float, Limits("simulated time [s]", 0.0, MAX_TIME_S)]
_SecondsOrNone = Annotated[float | None, Limits("simulated time [s]; None: not yet", 0.0, MAX_TIME_S)]
_OfBody = Annotated[float | None, Limits("state of a body; None: it has none", -MAX_TIME_S, MAX_TIME_S)]


class AgentState(NamedTuple):
    """One agent: its position [m; world frame], its own `TreeStatus`, and the state of a body that takes up room."""

    agent: _Agent
    x_m: _Metres
    y_m: _Metres
    role: Annotated[str, Limits("its role", check=role_name)]
    level: _Agent
    parent: _AgentOrNobody
    root: _AgentOrNobody = NOBODY
    delta: Annotated[int, Limits("events that make it a root", 0, MAX_DELTA)] = 0
    heading_rad: _OfBody = None
    """From x to y."""
    left_mps: _OfBody = None
    right_mps: _OfBody = None
    """Speeds of its wheels on the ground."""
    height_m: _OfBody = None
    """Above the ground, of one that flies, as the two that follow."""
    roll_rad: _OfBody = None
    """To the right."""
    pitch_rad: _OfBody = None
    """Up."""


BODY_FIELDS = AgentState._fields[8:11]
"""The fields that only bodies have that take up room."""

NOBODY_LEFT = "no agent was left"
"""Why a run ends of which all agents have failed."""


class EventState(NamedTuple):
    """One event that is incomplete or changed in this step. Times in s; None: not yet."""

    event: _Id
    x_m: _Metres
    y_m: _Metres
    arrived_s: _Seconds
    sensed_s: _SecondsOrNone
    worked_s: _SecondsOrNone
    completed_s: _SecondsOrNone
    work_agent_s: _Seconds


class StepRecord(NamedTuple):
    """The world's row of `series.csv`: what happened in one step.

    Each frame sent is one expected reception per other agent. Receptions that are neither complete nor dropped are in
    flight at the end of the step. With n agents, exactly:

        frames_in_flight before + frames_sent (n - 1) + frames_duplicated
            = frames_received + all drops + frames_in_flight

    `events_open` have arrived and are not complete at the end of the step; `events_completed` counts from the start of
    the run. `roots_from_densest_m` is the mean distance of roots from the place where events are densest; None without
    roots, and where events are equally dense everywhere. `delta` is the mean of the agents that have one; else None.

    Reports, exactly (without an uplink model each arrives in the step in which it is sent):

        reports_in_flight before + reports_sent = reports_arrived + all drops + reports_in_flight
    """

    step: int
    time_s: float
    agents_alive: int
    agents_late: int
    agents_asked: int
    agents_in_trees: int
    trees: int
    covered_area_m2: float | None
    roots_from_densest_m: float | None
    delta: float | None
    events_open: int
    events_completed: int
    frames_sent: int
    bytes_sent: int
    frames_received: int
    frames_duplicated: int
    frames_in_flight: int
    frames_dropped: Mapping[str, int]
    """Dropped receptions by reason: `DROP_REASONS`, then those of radio models from outside."""
    reports_sent: int
    reports_arrived: int
    reports_in_flight: int
    reports_dropped: Mapping[str, int]
    """Dropped reports by reason, `UPLINK_REASONS`."""
    rejected: int
    transport_lost: int
    metrics: Mapping[str, float | None] = {}
    """The controller's own numbers by name: means over the agents that have one."""

    def columns(self) -> dict[str, Any]:
        """Return the row by column; each reason of a drop, and each of the controller's own numbers, has one."""
        row: dict[str, Any] = {}
        for name, value in self._asdict().items():
            prefix = _DROPS.get(name)
            row |= {name: value} if prefix is None else {f"{prefix}{reason}": n for reason, n in value.items()}
        return row

    def values(self) -> list[Any]:
        """Return the values of `columns`, in a tenth of the time."""
        frames, reports, metrics = _DROPS_AT
        return [
            *self[:frames],
            *self.frames_dropped.values(),
            *self[frames + 1 : reports],
            *self.reports_dropped.values(),
            *self[reports + 1 : metrics],
            *self.metrics.values(),
        ]

    @classmethod
    def of(cls, columns: Mapping[str, Any]) -> Self:
        """Make a row from the values of its columns; other columns are ignored."""
        fields = {**columns, **{name: {} for name in _DROPS}}
        for column, count in columns.items():
            for name, prefix in _DROPS.items():
                if column.startswith(prefix):
                    fields[name][column.removeprefix(prefix)] = count
        return cls._make(fields[name] for name in cls._fields)


_DROPS = {"frames_dropped": "dropped_", "reports_dropped": "reports_dropped_", "metrics": PREFIX}
"""The fields of `StepRecord` with a column for each reason or name, and how these columns begin."""

_DROPS_AT = tuple(StepRecord._fields.index(name) for name in _DROPS)

_REASONS = {"frames_dropped": DROP_REASONS, "reports_dropped": UPLINK_REASONS}

COLUMNS = tuple(StepRecord._make(dict.fromkeys(_REASONS.get(name, ()), 0) for name in StepRecord._fields).columns())
"""The columns of a row without radio models from outside."""


def _step_record(row: Any, field: str) -> StepRecord:
    others = row[-1] if isinstance(row, list) and len(row) == len(COLUMNS) + 1 else {}
    array(row, len(COLUMNS) + bool(others), field)
    named = {**dict(zip(COLUMNS, row, strict=False)), **_other_columns(others, field)}
    values: dict[str, Any] = {"time_s": number(named.pop("time_s"), 0.0, MAX_TIME_S, f"{field}.time_s")}
    for name, most in _MEASURED.items():
        value = named.pop(name)
        values[name] = None if value is None else number(value, 0.0, most, f"{field}.{name}")
    for name in [name for name in named if name.startswith(PREFIX)]:
        value = named.pop(name)
        values[name] = None if value is None else number(value, -METRIC_LIMIT, METRIC_LIMIT, f"{field}.{name}")
    for name, value in named.items():
        values[name] = integer(value, 0, MAX_ID, f"{field}.{name}")
    return StepRecord.of(values)


def _other_columns(columns: Any, field: str) -> dict[str, Any]:
    if not isinstance(columns, dict) or not all(
        type(name) is str and name.startswith(("dropped_", PREFIX)) for name in columns
    ):
        raise WireError(field, "end with a map of drops and metrics", type(columns).__name__)
    return columns


_MEASURED = {"covered_area_m2": MAX_ABS_M**2, "roots_from_densest_m": 2 * MAX_ABS_M, "delta": float(MAX_DELTA)}
"""Fields of `StepRecord` that may be None, and their greatest values."""


MAX_BODIES = MAX_AGENT_ID + 1
MAX_EVENTS = 100_000
MAX_LINKS = 1_000_000


def _links(rows: Any, field: str) -> tuple[tuple[int, int], ...]:
    of_sender, of_receiver, most = f"{field}.sender", f"{field}.receiver", MAX_AGENT_ID
    return tuple(
        [
            (integer(sender, 0, most, of_sender), integer(receiver, 0, most, of_receiver))
            for sender, receiver in [array(row, 2, field) for row in arrays(rows, MAX_LINKS, field)]
        ]
    )


class Truth(NamedTuple):
    step: _Step
    time_s: _Seconds
    bodies: Annotated[tuple[AgentState, ...], Limits("all agents", most=MAX_BODIES)]
    events: Annotated[tuple[EventState, ...], Limits("open events, and those that changed", most=MAX_EVENTS)]
    links: Annotated[tuple[tuple[int, int], ...], Limits("sender and receiver of each frame", check=_links)]
    step_record: Annotated[StepRecord, Limits("what happened", check=_step_record)]


_TRUTH = Record(Truth, "truth", MAX_ORDINARY_BYTES)
decode_truth = _TRUTH.decode


def encode_truth(truth: Truth) -> bytes:
    """A map with the fields of `Truth` and the version `v`; rows are arrays. Raises WireError.

    The step's record ends with a map of the drops of radio models from outside, and of the controller's own numbers, if
    there are any.
    """
    row: Any = truth.step_record.values()
    if len(row) > len(COLUMNS):
        columns = truth.step_record.columns()
        row = [*(columns.pop(name) for name in COLUMNS), columns]
    bodies: Any = [_row(body) for body in truth.bodies]
    return _TRUTH.encode(truth._replace(bodies=bodies, step_record=row))


def _row(body: AgentState) -> tuple[Any, ...]:
    """Leave out what its kind of body has no state of: height if it does not fly, and all if it is a point."""
    return body[:8] if body.heading_rad is None else body[:11] if body.height_m is None else body


Sample = tuple[int, int, bytes]
"""Agent, kind (see `digest`), and the sample as the agent encoded it."""


def encode_wire(step: int, samples: Sequence[Sample]) -> bytes:
    """The raw radio frames and reports of a step: a map of `v`, `step` and `samples`. Raises WireError."""
    return pack({"v": PROTOCOL_VERSION, "step": step, "samples": samples}, MAX_ORDINARY_BYTES)


def decode_wire(data: bytes) -> tuple[int, list[Sample]]:
    """Decode the step and the samples sent in it. Raises WireError."""
    raw = fields(unpack(data, MAX_ORDINARY_BYTES), ("step", "samples"), "wire")
    return integer(raw["step"], 0, MAX_STEP, "wire.step"), [
        _sample(row) for row in arrays(raw["samples"], 2 * MAX_BODIES, "wire.samples")
    ]


def _sample(row: Any) -> Sample:
    agent, kind, data = array(row, 3, "wire.samples")
    return (
        integer(agent, 0, MAX_AGENT_ID, "wire.samples.agent"),
        integer(kind, 0, REPORT, "wire.samples.kind"),
        octets(data, MAX_ORDINARY_BYTES, "wire.samples"),
    )
