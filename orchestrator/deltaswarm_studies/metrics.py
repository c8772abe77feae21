"""Metrics: one number per run, from a sweep's table, from its time series, or from its events and messages."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from deltaswarm_orchestrator.results.metric import COUNT, RATE, Metric
from deltaswarm_orchestrator.results.metric import PER_EVENT as BY_EVENT
from deltaswarm_orchestrator.results.summary import EVERY_KEY
from deltaswarm_orchestrator.results.summary import controllers_own as own_metrics
from deltaswarm_wire.checked import Problem, SettingsError, key
from deltaswarm_wire.controller_metrics import PREFIX

if TYPE_CHECKING:
    import pandas as pd

    from deltaswarm_orchestrator.sweeps.plan import Sweep

COLUMN, WINDOW, CONVERGENCE, COST = "column", "window", "time_to_converge", "cost"
OWN = "controller."
"""How the names of a controller's own metrics begin."""

ID = ["variant", "replicate", "seed"]
"""The columns that identify a run."""


@dataclass(frozen=True)
class StudyMetric:
    """How a run's number is computed, and its name for people."""

    title: str
    unit: str = ""
    column: str = ""
    """Column of the sweep's table."""
    series: str = ""
    """Column of the sweep's time series, which has means over windows; empty if there is none."""
    kind: str = COLUMN
    of: str = ""
    """The metric whose series this one is computed from, unless the kind is `column`."""
    from_s: float = 0.0
    until_s: float = math.inf
    share: float = 0.9
    smooth_s: float = 600.0
    price_s: float = 0.0
    after_change: bool = False

    @property
    def needs_series(self) -> bool:
        return self.kind in (WINDOW, CONVERGENCE)

    def within(self, name: str, from_s: float, until_s: float | None) -> "StudyMetric":
        """Return the metric `name` taken over a stretch of time; unchanged if it has no series."""
        if not self.series or (from_s == 0 and until_s is None):
            return self
        return replace(self, kind=WINDOW, of=name, from_s=from_s, until_s=math.inf if until_s is None else until_s)

    @property
    def label(self) -> str:
        """Title and unit, for axes and headings."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True)
class MetricSettings:
    """A table `[[metric]]` of a study file."""

    name: str = key("", "by which the study refers to it")
    title: str = key("", "for people, without the unit")
    unit: str = key("", "its unit")
    kind: str = key(
        COLUMN,
        "how it is found; cost: the mean delay of a run's events, plus a price times the messages per event",
        choices=(COLUMN, WINDOW, CONVERGENCE, COST),
    )
    column: str = key("", "column: of the sweep's table")
    of: str = key("", "window, time_to_converge: the built-in metric that is followed over time")
    from_s: float = key(0.0, "window: start [s]; cost: of the events that arrive from then on", low=0)
    until_s: float | None = key(None, "window, cost: end [s]; default: the end of the run", low=0)
    share: float = key(0.9, "time_to_converge: reached at this share of the mean of the last third", above=0)
    smooth_s: float = key(600.0, "time_to_converge: length of the running mean [s]", above=0)
    price_s: float = key(0.0, "cost: what one message to the operator is worth, as delay of an event [s]", low=0)
    after_change: bool = key(
        False,
        "cost: from_s and until_s count from when the rate or a place of events first changes at once; a run without "
        "such a change has no value",
    )

    def problems(self) -> Iterator[Problem]:
        """List what the metric's kind needs and does not have."""
        if not self.name:
            yield Problem("name", "missing", "a metric needs a name")
        elif self.kind != COST and (self.price_s or self.after_change):
            name = "price_s" if self.price_s else "after_change"
            yield Problem(name, f"kind {self.kind!r}", "must be left out: only kind 'cost' has it")
        elif self.kind == COLUMN and not self.column:
            yield Problem("column", "missing", "a metric of kind 'column' needs it")
        elif self.kind == COST:
            yield from self._cost_problems()
        elif self.kind != COLUMN and not ((source := named(self.of)) and source.series):
            over_time = ", ".join(name for name, metric in BUILT_IN.items() if metric.series)
            yield Problem("of", repr(self.of), f"must be one of {over_time}")

    def _cost_problems(self) -> Iterator[Problem]:
        has_window = self.from_s > 0 or self.until_s is not None or self.after_change
        if self.price_s and has_window:
            allowed = "must be 0 for some of the events: messages are counted over the whole run"
            yield Problem("price_s", f"{self.price_s:.15g}", allowed)
        if self.until_s is not None and self.until_s <= self.from_s:
            yield Problem("until_s", f"{self.until_s:.15g}", f"must be after from_s, {self.from_s:.15g} s")

    def metric(self) -> StudyMetric:
        """Return the metric that the table describes."""
        if self.kind == COST:
            more = f", plus {self.price_s:g} s a message" if self.price_s else " after a change" * self.after_change
            title = self.title or f"Mean delay of an event{more}"
            own = {name: getattr(self, name) for name in ("kind", "from_s", "price_s", "after_change")}
            return StudyMetric(title, self.unit or "s", self.name, until_s=self._until_s, **own)
        source = named(self.of)
        unit = self.unit or (source.unit if source and self.kind == WINDOW else "s" if source else "")
        title = self.title or (source.title if source else self.column)
        return StudyMetric(
            *(title, unit, self.column, source.series if source else "", self.kind, self.of),
            *(self.from_s, self._until_s, self.share, self.smooth_s),
        )

    @property
    def _until_s(self) -> float:
        return math.inf if self.until_s is None else self.until_s


def named(name: str) -> "StudyMetric | None":
    """Return a metric of every run by its name; of a controller's own its columns, since the name alone is known."""
    own = name.removeprefix(OWN)
    return StudyMetric(own, column=name, series=PREFIX + own) if own != name else BUILT_IN.get(name)


WAITING = "waiting"
"""The paper's mean waiting time: of the events that were sensed, up to the end of the run."""

WAITING_ALL, COMPLETION = "waiting_all", "completion_s"
"""Means over all events that could be followed for the horizon, which bounds each of them."""

BUILT_IN: Mapping[str, StudyMetric] = {
    metric.study: StudyMetric(metric.title, metric.unit, metric.key, metric.over.column if metric.over else "")
    for metric in EVERY_KEY
    if metric.study
}


def controllers_own(sweep: "Sweep") -> dict[str, StudyMetric]:
    """Return the metrics that the controllers of a sweep declare.

    Raises:
        SettingsError: two declare one name with different units.
    """
    found: dict[str, StudyMetric] = {}
    for mode in dict.fromkeys(scenario.control.mode for scenario in sweep.scenarios):
        for metric in own_metrics(mode):
            series = metric.over.column if metric.over else ""
            one = found.setdefault(metric.key, StudyMetric(metric.title, metric.unit, metric.key, series))
            if one.unit != metric.unit:
                allowed = f"must declare {metric.key} in the unit {one.unit!r}, as another controller of the sweep does"
                raise SettingsError([Problem("control.mode", f"{mode!r} in {metric.unit!r}", allowed)])
    return found


def _of_kind(kind: str) -> tuple[str, ...]:
    return tuple(metric.study for metric in EVERY_KEY if metric.over and metric.over.kind == kind)


_OF_EVENTS = {metric.key: metric for metric in EVERY_KEY if metric.moment}


def source_of(metric: StudyMetric) -> Metric | None:
    """Return the run's metric of the time until a moment that a study's metric is, or is a window of; None: another."""
    source = named(metric.of) if metric.kind == WINDOW else metric if metric.kind == COLUMN else None
    return _OF_EVENTS.get(source.column) if source else None


PER_STEP = _of_kind(RATE)
"""Metrics per second whose time series has numbers per step."""

PER_EVENT = _of_kind(BY_EVENT)
"""Metrics whose time series has means over the events that arrived in a window, and that the horizon bounds."""

COUNTS = _of_kind(COUNT)
"""Metrics that are numbers of events: sums over time, where others are means."""


@dataclass(frozen=True)
class Timing:
    """Lengths of time in a sweep's runs."""

    step_s: Mapping[str, float]
    """Length of a step by variant [s]."""
    end_s: Mapping[str, float]
    """End of the runs by variant [s]."""
    every_s: float
    """Length of a window of the time series [s]."""

    def windows(self, time_s: float) -> int:
        """Return the number of whole windows in a time."""
        return math.floor(time_s / self.every_s + 1e-9)

    def index(self, times_s: "pd.Series") -> "pd.Series":
        """Return the number of each window, by its start."""
        return (times_s / self.every_s).round().astype(int)

    def per_second(self, name: str, values: "pd.Series", variants: "pd.Series") -> "pd.Series":
        """Turn a metric's numbers per step into numbers per second."""
        return values / _by_variant(self.step_s, variants) if name in PER_STEP else values

    def is_within(self, ends_s: "pd.Series", variants: "pd.Series") -> "pd.Series":
        """Return whether each of these moments lies within its run, or at its end."""
        return ends_s <= _by_variant(self.end_s, variants) + 1e-9 * self.every_s


def _by_variant(values: Mapping[str, float], variants: "pd.Series") -> "pd.Series":
    """Look up a number for each variant; of no variants, pandas' `map` alone returns a series of texts."""
    return variants.map(values).astype(float)
