"""Data recorded by one run, and the functions that metrics are computed with."""

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from statistics import fmean, median
from typing import Any, NamedTuple

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import EventState, StepRecord
from deltaswarm_wire import digest
from deltaswarm_wire.operator_messages import Workload


class EventLife(NamedTuple):
    """A row of `events.csv`: one event, as the world and the operator saw it. Times in s; None: not yet."""

    event: int
    x_m: float
    y_m: float
    arrived_s: float
    sensed_s: float | None
    told_s: float | None
    """The operator's own count: when the first report that names the event arrived."""
    worked_s: float | None
    completed_s: float | None
    work_agent_s: float
    shown_s: float | None = None
    """When the inbox of the person at the console first showed a message that names the event."""
    read_s: float | None = None
    """When the person first read one."""


TimeOf = Callable[[EventLife], float | None]
"""A time in the life of an event [s]; None: it has not come."""


TOLD_WEIGHT = 0.5
"""The weight of the time until an event is told in its delay; the rest is that of the time until it is complete."""

MINUTE_S = 60.0
ROUNDING = 1e-9
"""A time that is a whole number of minutes, but for rounding, begins one."""


@dataclass(frozen=True)
class Moment:
    """One of the moments in the life of an event."""

    column: str
    """Its column in the table of events [s]; without a value: it has not come."""
    state: str
    """What the event is from then on, in words."""

    def __call__(self, event: EventLife) -> float | None:
        time_s: float | None = getattr(event, self.column)
        return time_s


SENSED = Moment("sensed_s", "sensed")
TOLD = Moment("told_s", "told to the operator")
SHOWN = Moment("shown_s", "shown to the operator")
READ = Moment("read_s", "read by the operator")
WORKED = Moment("worked_s", "worked on")
COMPLETED = Moment("completed_s", "complete")


BY_OPERATOR = (TOLD.column, SHOWN.column, READ.column)
"""The moments that the operator's process knows, by event, where an outcome has them."""


@dataclass
class Outcome:
    """What the parts of one run recorded."""

    step_records: list[StepRecord] = field(default_factory=list)
    events: list[EventState] = field(default_factory=list)
    workloads: list[Workload] = field(default_factory=list)
    world: dict[str, Any] = field(default_factory=dict)
    operator: dict[str, Any] = field(default_factory=dict)
    told_s: Mapping[int, float] | None = None
    """By event, when the operator was first told of it [s]; None: the operator ended before it could say so."""
    shown_s: Mapping[int, float] | None = None
    """By event, when the inbox of the person at the console first showed it [s]; None: there was no person."""
    read_s: Mapping[int, float] | None = None
    """The same, when the person first read of it."""
    messages: list[str] = field(default_factory=list)
    """Messages for the user: agents that failed, and why."""
    traces: dict[str, str] = field(default_factory=dict)
    """The traceback of each part whose plug-in raised, by the part's name."""
    causes: dict[int, str] = field(default_factory=dict)
    """Why agents failed, by agent, as far as the world does not know it."""
    outlasted: dict[int, str] = field(default_factory=dict)
    """What the processes of agents did that had not ended by the end of the run, by agent."""

    @property
    def is_complete(self) -> bool:
        """Whether world and operator both reached the last step."""
        return bool(self.world.get("complete") and self.operator.get("complete"))

    @property
    def lives(self) -> list[EventLife]:
        """All events, with what the operator knew of each."""
        by_operator = {name: getattr(self, name) or {} for name in BY_OPERATOR}
        return [
            EventLife(**event._asdict() | {name: moments.get(event.event) for name, moments in by_operator.items()})
            for event in self.events
        ]

    @property
    def digest(self) -> str | None:
        """The run's digest; None if the world's or the operator's is missing."""
        world, operator = self.world.get("digest"), self.operator.get("digest")
        return digest.combine(world, operator) if world and operator else None

    @property
    def events_digest(self) -> str | None:
        """A hash over the events themselves, of which the digest covers only what agents say; None without a digest."""
        if self.digest is None:
            return None
        told = repr([tuple(event) for event in sorted(self.events)])
        return hashlib.blake2b(told.encode(), digest_size=digest.SIZE_BYTES).hexdigest()


@dataclass(eq=False)
class RunData:
    outcome: Outcome
    scenario: Scenario

    @property
    def steps(self) -> list[StepRecord]:
        return self.outcome.step_records

    @property
    def workloads(self) -> list[Workload]:
        return self.outcome.workloads

    @cached_property
    def followed(self) -> list[EventLife]:
        run = self.scenario.run
        return followed(self.outcome.lives, len(self.steps) * run.step_s, self.scenario.metrics.horizon_s)

    def times_s(self, moment: Moment) -> list[float]:
        """Return the time from each followed event's arrival to a moment, at most the horizon [s]."""
        return [time_until(event, moment, self.scenario.metrics.horizon_s) for event in self.followed]


def median_of(values: Sequence[float]) -> float | None:
    return float(median(values)) if values else None


def percentile_95(values: Sequence[float]) -> float | None:
    """Return the smallest value that 95 % of the values do not exceed; None of nothing."""
    return sorted(values)[math.ceil(0.95 * len(values)) - 1] if values else None


def worst_tenth(values: Sequence[float]) -> float | None:
    """Return the mean of the largest tenth of the values, rounded up to whole values; None of nothing."""
    return mean_of(sorted(values)[-math.ceil(len(values) / 10) :])


def mean_of(values: Sequence[float]) -> float | None:
    return fmean(values) if values else None


def known(rows: Sequence[Any], column: str) -> list[Any]:
    """Return a column's values in the rows that have one."""
    return [value for row in rows if (value := getattr(row, column)) is not None]


def waits(run: RunData) -> list[float]:
    """Return the waiting time of each event that was sensed [s]."""
    return [event.sensed_s - event.arrived_s for event in run.outcome.events if event.sensed_s is not None]


def followed(events: Iterable[EventLife], end_s: float, horizon_s: float) -> list[EventLife]:
    """Return the events that arrived early enough before the end of the run [s] to be followed for the horizon.

    So neither late arrivals nor the length of a run bend the means over events.
    """
    return [event for event in events if event.arrived_s + horizon_s <= end_s]


def time_until(event: EventLife, moment: TimeOf, horizon_s: float) -> float:
    """Return the time from an event's arrival to a moment; at most the horizon, also if the moment has not come [s]."""
    then_s = moment(event)
    return horizon_s if then_s is None else min(then_s - event.arrived_s, horizon_s)


def delay_s(arrived_s: float, told_s: float | None, completed_s: float | None, end_s: float) -> float:
    """Return an event's delay: the mean of the times until the operator is told of it and until it is complete [s].

    What has not come by the end of the run counts until then.
    """
    told_s, completed_s = (end_s if time_s is None else time_s for time_s in (told_s, completed_s))
    return TOLD_WEIGHT * told_s + (1.0 - TOLD_WEIGHT) * completed_s - arrived_s


def arrival_digests(events: Iterable[EventState]) -> tuple[str, str]:
    """Return a digest of the times and one of the places of all arrivals, to check that two runs had the same."""
    ordered = sorted(events, key=lambda event: (event.arrived_s, event.event))
    columns = ([event.arrived_s for event in ordered], [(event.x_m, event.y_m) for event in ordered])
    times, places = (hashlib.blake2b(repr(column).encode(), digest_size=8).hexdigest() for column in columns)
    return times, places


Compute = Callable[[RunData], Any]
"""The computation of a metric."""


def mean(column: str, rows: Callable[[RunData], Sequence[Any]] = attrgetter("steps")) -> Compute:
    """Average a column over the steps that have a value."""
    return lambda run: mean_of(known(rows(run), column))


def per_second(column: str, rows: Callable[[RunData], Sequence[Any]] = attrgetter("steps")) -> Compute:
    """Average a count per step over the steps, per second."""

    def compute(run: RunData) -> float | None:
        per_step = mean_of(known(rows(run), column))
        return None if per_step is None else per_step / run.scenario.run.step_s

    return compute


def of_minutes(statistic: Callable[[Sequence[float]], float | None]) -> Compute:
    """Summarise the operator's message rates in whole minutes of the clock [1/s]."""

    def compute(run: RunData) -> float | None:
        messages = [0] * int(len(run.steps) * run.scenario.run.step_s / MINUTE_S + ROUNDING)
        for workload in run.workloads:
            minute = int(workload.time_s / MINUTE_S + ROUNDING)
            if minute < len(messages):
                messages[minute] += workload.messages
        return statistic([count / MINUTE_S for count in messages])

    return compute


def minutes_above(run: RunData) -> float | None:
    """Return the share of whole minutes with a message rate above the threshold."""
    threshold_hz = run.scenario.operator.threshold_hz
    share: float | None = of_minutes(lambda rates: mean_of([rate_hz > threshold_hz for rate_hz in rates]))(run)
    return share


def longest_above(run: RunData) -> float | None:
    """Return the longest time without a break in which the rate over 60 s was above the threshold [s]."""
    threshold_hz, longest, lasts = run.scenario.operator.threshold_hz, 0, 0
    for workload in run.workloads:
        lasts = lasts + 1 if workload.rate_60s_hz > threshold_hz else 0
        longest = max(longest, lasts)
    return longest * run.scenario.run.step_s if run.workloads else None


def news_per_second(run: RunData) -> float | None:
    news, simulated_s = run.outcome.operator.get("news"), len(run.steps) * run.scenario.run.step_s
    return None if news is None or not simulated_s else news / simulated_s


def total(column: str) -> Compute:
    """Sum a column over the steps."""
    return lambda run: sum(known(run.steps, column))


def by_reason(drops: str, reasons: Iterable[str]) -> Compute:
    """Sum drops over the run, by reason: these reasons first, then those of radio models from outside."""

    def compute(run: RunData) -> dict[str, int]:
        sums = dict.fromkeys(reasons, 0)
        for record in run.steps:
            for reason, count in getattr(record, drops).items():
                if count or reason not in sums:
                    sums[reason] = sums.get(reason, 0) + count
        return sums

    return compute


def newest(column: str) -> Compute:
    """Return a column's value in the last step."""
    return lambda run: getattr(run.steps[-1], column) if run.steps else 0


def of_bodies(name: str) -> Compute:
    return lambda run: run.outcome.world.get("bodies", {}).get(name, 0)


def own_mean(name: str) -> Compute:
    """Average a number of the controller's own over the steps in which an agent had one."""
    return lambda run: mean_of([value for record in run.steps if (value := record.metrics.get(name)) is not None])


def own_last(name: str) -> Compute:
    return lambda run: run.steps[-1].metrics.get(name) if run.steps else None


def time_to(moment: Moment, statistic: Callable[[Sequence[float]], float | None]) -> Compute:
    """Summarise the times until a moment over the followed events; None if the moment was not recorded."""

    def compute(run: RunData) -> float | None:
        is_unknown = moment.column in BY_OPERATOR and getattr(run.outcome, moment.column) is None
        return None if is_unknown else statistic(run.times_s(moment))

    return compute


def share_beyond_horizon(moment: Moment) -> Compute:
    """Return the share of the followed events whose moment did not come within the horizon."""
    return lambda run: time_to(
        moment, lambda times_s: mean_of([time_s >= run.scenario.metrics.horizon_s for time_s in times_s])
    )(run)


def read_too_late(run: RunData) -> float | None:
    """Return the share of completed followed events that the operator had not read of before; None without a person."""
    if run.outcome.read_s is None:
        return None
    completed = [(event.completed_s, event.read_s) for event in run.followed if event.completed_s is not None]
    return mean_of([read_s is None or read_s > completed_s for completed_s, read_s in completed])
