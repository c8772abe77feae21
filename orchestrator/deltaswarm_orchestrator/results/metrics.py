"""What one run recorded, and its metrics: the outcome of the task, the operator's workload, the swarm's traffic."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from statistics import fmean, median
from typing import Any, NamedTuple

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import DROP_REASONS, UPLINK_REASONS, EventState, StepRecord
from deltaswarm_wire import digest
from deltaswarm_wire.operator_messages import Workload


@dataclass
class Outcome:
    """What the parts of one run recorded."""

    step_records: list[StepRecord] = field(default_factory=list)
    events: list[EventState] = field(default_factory=list)
    workloads: list[Workload] = field(default_factory=list)
    world: dict[str, Any] = field(default_factory=dict)
    operator: dict[str, Any] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    """Messages for the user: agents that failed, and why."""

    @property
    def is_complete(self) -> bool:
        """Whether world and operator both reached the last step."""
        return bool(self.world.get("complete") and self.operator.get("complete"))

    @property
    def digest(self) -> str | None:
        """The run's digest; None if the world's or the operator's is missing."""
        world, operator = self.world.get("digest"), self.operator.get("digest")
        return digest.combine(world, operator) if world and operator else None


def metrics(outcome: Outcome, scenario: Scenario) -> dict[str, Any]:
    """Compute the metrics of an outcome. They do not depend on who recorded it; a recording gives the same."""
    records, workloads = outcome.step_records, outcome.workloads
    step_s, horizon_s = scenario.run.step_s, scenario.metrics.horizon_s
    events = followed(outcome.events, len(records) * step_s, horizon_s)
    waits = [event.sensed_s - event.arrived_s for event in outcome.events if event.sensed_s is not None]
    completions = [event.completion_s for event in events]
    times, places = arrival_digests(outcome.events)
    in_trees = _column(records, "agents_in_trees")
    with_trees = [record for record in records if record.trees]

    def total(name: str) -> int:
        return sum(_column(records, name))

    def mean(name: str) -> dict[str, float | None]:
        return {"mean": _mean(_column(records, name))}

    def mean_per_s(rows: Sequence[StepRecord] | Sequence[Workload], name: str) -> dict[str, float | None]:
        per_step = _mean(_column(rows, name))
        return {"mean": None if per_step is None else per_step / step_s}

    return {
        "waiting_time_s": {
            "mean": _mean(waits),
            "median": float(median(waits)) if waits else None,
            "n": len(waits),
            "never_sensed": len(outcome.events) - len(waits),
            "restricted_mean": _mean(_column(events, "waiting_s")),
        },
        "completion_s": {
            "mean": _mean(completions),
            "median": float(median(completions)) if completions else None,
        },
        "completed": sum(event.completed_s is not None for event in outcome.events),
        "open_events": mean("events_open"),
        "arrivals": {"n": len(outcome.events), "followed": len(events), "times": times, "places": places},
        "operator_messages_per_s": mean_per_s(workloads, "messages"),
        "operator_senders": {"mean": _mean(_column(workloads, "senders"))},
        "operator_time_above_threshold_s": workloads[-1].time_above_s if workloads else None,
        "frames_sent_per_s": mean_per_s(records, "frames_sent"),
        "frames_received_per_s": mean_per_s(records, "frames_received"),
        "bytes_sent_per_s": mean_per_s(records, "bytes_sent"),
        "frames": {
            **{name: total(f"frames_{name}") for name in ("sent", "received", "duplicated")},
            "in_flight": records[-1].frames_in_flight if records else 0,
        },
        "frames_dropped": {reason: total(f"dropped_{reason}") for reason in DROP_REASONS},
        "reports": {
            **{name: total(f"reports_{name}") for name in ("sent", "arrived")},
            "in_flight": records[-1].reports_in_flight if records else 0,
        },
        "reports_dropped": {reason: total(f"reports_dropped_{reason}") for reason in UPLINK_REASONS},
        "agents_in_trees": {"mean": _mean(in_trees), "last_third_mean": _mean(in_trees[len(in_trees) * 2 // 3 :])},
        "trees": mean("trees"),
        "roots_from_densest_m": mean("roots_from_densest_m"),
        "delta": mean("delta"),
        "covered_area_m2": {
            **mean("covered_area_m2"),
            "mean_while_trees": _mean(_column(with_trees, "covered_area_m2")),
        },
        "transport_lost": total("transport_lost") + sum(workload.lost for workload in workloads),
        "samples_rejected": total("rejected") + sum(workload.rejected for workload in workloads),
        "steps": len(records),
    }


class FollowedEvent(NamedTuple):
    """An event that arrived early enough to be followed for the horizon; each time is at most the horizon [s]."""

    arrived_s: float
    waiting_s: float
    """Until an agent first sensed it."""
    completion_s: float
    """Until it was complete."""


def followed(events: Iterable[EventState], end_s: float, horizon_s: float) -> list[FollowedEvent]:
    """Restrict events to a horizon, so that neither late arrivals nor the length of a run bend their means.

    Args:
        events: all events of a run.
        end_s: the end of the run [s]; events younger than the horizon then are left out.
        horizon_s: how long each event is followed [s]; what has not happened by then counts as this.
    """
    return [
        FollowedEvent(
            event.arrived_s,
            *(
                horizon_s if then_s is None else min(then_s - event.arrived_s, horizon_s)
                for then_s in (event.sensed_s, event.completed_s)
            ),
        )
        for event in events
        if event.arrived_s + horizon_s <= end_s
    ]


def arrival_digests(events: Iterable[EventState]) -> tuple[str, str]:
    """Return a digest of the times and one of the places of all arrivals, to check that two runs had the same."""
    ordered = sorted(events, key=lambda event: (event.arrived_s, event.event))
    columns = ([event.arrived_s for event in ordered], [(event.x_m, event.y_m) for event in ordered])
    times, places = (hashlib.blake2b(repr(column).encode(), digest_size=8).hexdigest() for column in columns)
    return times, places


def _column(rows: Sequence[Any], name: str) -> list[Any]:
    """Return what the rows know of one quantity."""
    return [value for row in rows if (value := getattr(row, name)) is not None]


def _mean(values: Sequence[float]) -> float | None:
    return fmean(values) if values else None
