"""Every metric of a run: its name, unit, meaning and computation, and where it is shown.

A new metric is one entry of `METRICS`; computations that several share are in `outcome.py`. The summary of a run, the
table and the time series of a sweep, studies, sessions, `deltaswarm info` and docs/RESULTS.md follow from the entry.
`summary.py` has the other keys of the summary.
"""

from dataclasses import dataclass
from operator import attrgetter

from deltaswarm_orchestrator.results.outcome import (
    COMPLETED,
    READ,
    SENSED,
    SHOWN,
    TOLD,
    WORKED,
    Compute,
    Moment,
    TimeOf,
    arrival_digests,
    by_reason,
    known,
    mean,
    mean_of,
    median_of,
    newest,
    of_bodies,
    per_second,
    percentile_95,
    read_too_late,
    share_beyond_horizon,
    time_to,
    total,
    waits,
    worst_tenth,
)
from deltaswarm_scenario.truth import DROP_REASONS, UPLINK_REASONS

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


# Metrics, in the order of the summary

_WORKLOADS = attrgetter("workloads")

METRICS = (
    *until(
        SENSED,
        "waiting_time_s.restricted_mean",
        "waiting_time_s.restricted_median",
        study="waiting_all",
        column="waiting_time_s",
        session="waiting_time_s",
    ),
    *until(
        TOLD,
        "told_s.mean",
        "told_s.median",
        study="told_s",
        column="told_time_s",
        session="told_s",
    ),
    *until(SHOWN, "shown_s.mean", "shown_s.median", study="shown_s", session=""),
    *until(READ, "read_s.mean", "read_s.median", study="read_s", session=""),
    Metric(
        "read_s.too_late_share",
        "share of the followed events that were complete before the operator had read of them, of those that were "
        "completed",
        compute=read_too_late,
        title="Share of events read only after they were complete",
        study="read_too_late",
    ),
    *until(
        WORKED,
        "worked_s.mean",
        "worked_s.median",
        study="worked_s",
        column="worked_time_s",
        session="worked_s",
    ),
    *until(
        COMPLETED,
        "completion_s.mean",
        "completion_s.median",
        study="completion_s",
        column="completion_time_s",
        session="completion_s",
    ),
    Metric(
        "horizon_s",
        "time for which events are followed: the ceiling of the times above",
        "s",
        lambda run: run.scenario.metrics.horizon_s,
    ),
    Metric(
        "waiting_time_s.mean",
        "from arrival until an agent first senses the event, over the events that were sensed",
        "s",
        lambda run: mean_of(waits(run)),
        title="Mean waiting time of sensed events",
        label="mean waiting time of sensed events",
        study="waiting",
    ),
    Metric(
        "waiting_time_s.median",
        "the same, median",
        "s",
        lambda run: median_of(waits(run)),
    ),
    Metric(
        "waiting_time_s.n",
        "events that were sensed",
        compute=lambda run: len(waits(run)),
        label="events sensed",
    ),
    Metric(
        "waiting_time_s.never_sensed",
        "events that nobody sensed",
        compute=lambda run: len(run.outcome.events) - len(waits(run)),
        title="Events never sensed",
        label="events never sensed",
        study="never_sensed",
        over=OverTime("never_sensed", COUNT, lambda event: event.arrived_s if event.sensed_s is None else None),
    ),
    Metric(
        "completed",
        "completed events",
        compute=lambda run: len(known(run.outcome.events, "completed_s")),
        title="Events completed",
        label="events completed",
        study="completed",
        over=OverTime("completed", COUNT, COMPLETED),
        session="completed",
        is_whole=True,
    ),
    Metric(
        "open_events.mean",
        "events that have arrived and are not complete",
        compute=mean("events_open"),
        title="Open events",
        label="open events",
        study="open_events",
        over=OverTime("events_open"),
    ),
    Metric("arrivals.n", "events", compute=lambda run: len(run.outcome.events)),
    Metric("arrivals.followed", "events that could be followed", compute=lambda run: len(run.followed)),
    Metric(
        "arrivals.times",
        "digest of the times of all events, to compare arrivals",
        compute=lambda run: arrival_digests(run.outcome.events)[0],
    ),
    Metric("arrivals.places", "the same of their places", compute=lambda run: arrival_digests(run.outcome.events)[1]),
    Metric(
        "operator_messages_per_s.mean",
        "messages to the operator",
        "1/s",
        per_second("messages", _WORKLOADS),
        title="Messages to the operator",
        label="operator messages",
        study="messages",
        over=OverTime("operator_messages", RATE),
        session="messages_per_s",
    ),
    Metric(
        "operator_senders.mean",
        "agents that report in a step",
        compute=mean("senders", _WORKLOADS),
        title="Agents that report in a step",
        study="senders",
    ),
    Metric(
        "operator_time_above_threshold_s",
        "time with the message rate above the threshold",
        "s",
        lambda run: run.workloads[-1].time_above_s if run.workloads else None,
        title="Time with too many messages",
        study="above_threshold",
        session="time_above_threshold_s",
    ),
    Metric(
        "frames_sent_per_s.mean",
        "radio frames of all agents",
        "1/s",
        per_second("frames_sent"),
        title="Radio frames sent",
        label="radio frames sent",
        study="frames_sent",
        over=OverTime("frames_sent", RATE),
    ),
    Metric(
        "frames_received_per_s.mean",
        "receptions of radio frames",
        "1/s",
        per_second("frames_received"),
        title="Radio frames received",
        study="frames_received",
        over=OverTime("frames_received", RATE),
    ),
    Metric(
        "bytes_sent_per_s.mean",
        "bytes in radio frames of all agents",
        "bytes/s",
        per_second("bytes_sent"),
        label="radio bytes sent",
    ),
    Metric("frames.sent", "radio frames, over the run", compute=total("frames_sent")),
    Metric("frames.received", "receptions", compute=total("frames_received")),
    Metric("frames.duplicated", "extra receptions of duplicated frames", compute=total("frames_duplicated")),
    Metric("frames.in_flight", "receptions pending at the end", compute=newest("frames_in_flight")),
    Metric(
        "frames_dropped", "receptions that did not happen, by reason", compute=by_reason("frames_dropped", DROP_REASONS)
    ),
    Metric(
        "reports.sent",
        "reports, over the run",
        compute=total("reports_sent"),
        label="reports sent",
    ),
    Metric(
        "reports.arrived",
        "reports that reached the operator",
        compute=total("reports_arrived"),
        label="reports arrived",
    ),
    Metric("reports.in_flight", "reports under way at the end", compute=newest("reports_in_flight")),
    Metric(
        "reports_dropped",
        "reports that did not reach the operator, by reason",
        compute=by_reason("reports_dropped", UPLINK_REASONS),
    ),
    Metric(
        "agents_in_trees.mean",
        "agents in trees, roots included",
        compute=mean("agents_in_trees"),
        title="Agents in trees",
        label="agents in trees",
        study="agents_in_trees",
        over=OverTime("agents_in_trees"),
    ),
    Metric(
        "agents_in_trees.last_third_mean",
        "the same over the last third of the run",
        compute=lambda run: mean_of(known(run.steps[len(run.steps) * 2 // 3 :], "agents_in_trees")),
    ),
    Metric(
        "trees.mean",
        "number of trees",
        compute=mean("trees"),
        title="Trees",
        label="trees",
        study="trees",
        over=OverTime("trees"),
    ),
    Metric(
        "roots_from_densest_m.mean",
        "distance of roots from the place where events are densest; if the density moves, at that time, to within 10 s",
        "m",
        mean("roots_from_densest_m"),
        title="Distance of roots from the densest place",
        study="root_distance",
        over=OverTime("roots_from_densest_m"),
    ),
    Metric(
        "delta.mean",
        "mean delta of the agents that have one, which `adaptive` chooses while it runs",
        compute=mean("delta"),
        title="Delta that agents use",
        study="delta",
        over=OverTime("delta"),
    ),
    Metric(
        "covered_area_m2.mean",
        "area that agents in trees sense",
        "m²",
        mean("covered_area_m2"),
        title="Area covered",
        study="area",
        over=OverTime("covered_area_m2"),
    ),
    Metric(
        "covered_area_m2.mean_while_trees",
        "the same over the steps with trees",
        "m²",
        mean("covered_area_m2", lambda run: [record for record in run.steps if record.trees]),
        title="Area covered while there are trees",
        label="area covered while trees exist",
        study="tree_area",
    ),
    Metric(
        "bodies.blocked_share",
        "share of agent-steps in which something kept a body from moving as commanded; 0 for points",
        compute=of_bodies("blocked_share"),
        title="Share of the time spent blocked",
        study="blocked_share",
    ),
    Metric(
        "bodies.bumped_share",
        "share of agent-steps in which a body touched another one, an obstacle or the arena's edge; 0 for points",
        compute=of_bodies("bumped_share"),
        title="Share of the time in touch",
        study="bumped_share",
    ),
    Metric(
        "bodies.jams",
        "jams: a body that wanted to move got no further than its diameter for a minute; 0 for points",
        compute=of_bodies("jams"),
        title="Jams",
        study="jams",
    ),
    Metric(
        "transport_lost",
        "messages lost on the fabric",
        compute=lambda run: total("transport_lost")(run) + sum(known(run.workloads, "lost")),
        label="lost on the fabric",
    ),
    Metric(
        "samples_rejected",
        "messages that broke the protocol",
        compute=lambda run: total("rejected")(run) + sum(known(run.workloads, "rejected")),
    ),
    Metric("steps", "steps done", compute=lambda run: len(run.steps), label="steps"),
)
