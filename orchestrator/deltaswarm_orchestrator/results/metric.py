"""Define a metric of a run, and the metrics of the time until an event is sensed, told, read, worked on or complete."""

from dataclasses import dataclass

from deltaswarm_orchestrator.results.outcome import (
    COMPLETED,
    Compute,
    Moment,
    TimeOf,
    mean_of,
    median_of,
    percentile_95,
    share_beyond_horizon,
    time_to,
    worst_tenth,
)

PER_STEP, RATE, COUNT, PER_EVENT = "per step", "rate", "count", "per event"


@dataclass(frozen=True)
class OverTime:
    """A metric's column in a sweep's time series, whose rows are windows of time.

    The kind is PER_STEP, a mean over the steps of a window; RATE, the same, shown per second; COUNT, the number of
    events whose moment lies in the window; or PER_EVENT, the mean time until their moment of the followed events that
    arrived in the window, with the horizon as ceiling.
    """

    column: str
    kind: str = PER_STEP
    moment: TimeOf = COMPLETED


@dataclass(frozen=True)
class Metric:
    """One number of a run."""

    key: str
    """Its dotted name in `summary.json` and in a sweep's table."""
    meaning: str
    unit: str = ""
    compute: Compute | None = None
    """None: a part of the run or a later stage computes it."""
    label: str = ""
    """Its name in the table that a run and `deltaswarm info` print; empty: it is not there."""
    title: str = ""
    """Its name on the axes and in the tables of studies, without the unit."""
    study: str = ""
    """Its name in studies; empty: studies do not use it."""
    over: OverTime | None = None
    """How it is followed over time; None: it is not."""
    session: str = ""
    """Its column in the table of a session's runs; empty: it has none."""
    is_in_summary: bool = True
    """False: only the table of a session's runs has it, since it is known only after the run."""
    is_whole: bool = False
    """Whether it is a whole number."""
    moment: Moment | None = None
    """It is about the time until this moment of events that could be followed for the horizon; None: something else."""

    @property
    def is_restricted(self) -> bool:
        """Whether the horizon is its ceiling: as large as that, it says nothing but that it is no less."""
        return self.moment is not None and self.unit == "s"


def until(moment: Moment, mean: str, median: str, study: str, session: str, column: str = "") -> list[Metric]:
    """Return the metrics of the time from an event's arrival until a moment, which the horizon bounds.

    `mean` and `median` are their names in the summary, `study` that of the mean, `column` that of its time series;
    without one they are not in the table that a run prints either.
    """
    above, short, state = mean.partition(".")[0], study.partition("_")[0], moment.state
    return [
        Metric(
            mean,
            f"time from an event's arrival until it is {state}, mean over the events that could be followed for the "
            "horizon; a longer time counts as the horizon",
            "s",
            time_to(moment, mean_of),
            title=f"Mean time until an event is {state}",
            label=f"mean time until {state}" if column else "",
            study=study,
            over=OverTime(column, PER_EVENT, moment) if column else None,
            session=session,
            moment=moment,
        ),
        Metric(median, "the same, median", "s", time_to(moment, median_of), moment=moment),
        Metric(
            f"{above}.p95",
            "the same, 95th percentile",
            "s",
            time_to(moment, percentile_95),
            title=f"Time until an event is {state}, 95th percentile",
            study=f"{short}_p95",
            moment=moment,
        ),
        Metric(
            f"{above}.worst_tenth",
            "the same, mean over the tenth of these events for which it took longest",
            "s",
            time_to(moment, worst_tenth),
            title=f"Mean time until an event is {state}, slowest tenth",
            study=f"{short}_worst_tenth",
            moment=moment,
        ),
        Metric(
            f"{above}.beyond_horizon",
            "share of these events for which it took longer than the horizon",
            compute=share_beyond_horizon(moment),
            title=f"Share of events not {state} within the horizon",
            study=f"{short}_beyond",
            moment=moment,
        ),
    ]
