"""The metrics of one run: the outcome of the task, the operator's workload, the traffic within the swarm."""

import hashlib
from collections.abc import Iterable, Sequence
from statistics import fmean, median
from typing import Any, NamedTuple

from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import DROP_REASONS, UPLINK_REASONS, EventState


def metrics(outcome: Outcome, scenario: Scenario) -> dict[str, Any]:
    """Compute the metrics of an outcome. They do not depend on who recorded it; a recording gives the same."""
    step_records, workloads = outcome.step_records, outcome.workloads
    step_s, horizon_s = scenario.run.step_s, scenario.metrics.horizon_s
    events = followed(outcome.events, len(step_records) * step_s, horizon_s)
    waits = [e.sensed_s - e.arrived_s for e in outcome.events if e.sensed_s is not None]
    times, places = arrival_digests(outcome.events)
    covered = [t.covered_area_m2 for t in step_records if t.covered_area_m2 is not None]
    with_trees = [t.covered_area_m2 for t in step_records if t.covered_area_m2 is not None and t.trees]
    in_trees = [t.agents_in_trees for t in step_records]
    return {
        "waiting_time_s": {
            "mean": _mean(waits),
            "median": float(median(waits)) if waits else None,
            "n": len(waits),
            "never_sensed": len(outcome.events) - len(waits),
            "restricted_mean": _mean([event.waiting_s for event in events]),
        },
        "completion_s": {
            "mean": _mean([event.completion_s for event in events]),
            "median": float(median(event.completion_s for event in events)) if events else None,
        },
        "completed": sum(event.completed_s is not None for event in outcome.events),
        "open_events": {"mean": _mean([t.events_open for t in step_records])},
        "arrivals": {"n": len(outcome.events), "followed": len(events), "times": times, "places": places},
        "operator_messages_per_s": {"mean": _rate([w.messages for w in workloads], step_s)},
        "operator_senders": {"mean": _mean([w.senders for w in workloads])},
        "operator_time_above_threshold_s": workloads[-1].time_above_s if workloads else None,
        "frames_sent_per_s": {"mean": _rate([t.frames_sent for t in step_records], step_s)},
        "frames_received_per_s": {"mean": _rate([t.frames_received for t in step_records], step_s)},
        "bytes_sent_per_s": {"mean": _rate([t.bytes_sent for t in step_records], step_s)},
        "frames": {
            "sent": sum(t.frames_sent for t in step_records),
            "received": sum(t.frames_received for t in step_records),
            "duplicated": sum(t.frames_duplicated for t in step_records),
            "in_flight": step_records[-1].frames_in_flight if step_records else 0,
        },
        "frames_dropped": {
            reason: sum(getattr(t, f"dropped_{reason}") for t in step_records) for reason in DROP_REASONS
        },
        "reports": {
            "sent": sum(t.reports_sent for t in step_records),
            "arrived": sum(t.reports_arrived for t in step_records),
            "in_flight": step_records[-1].reports_in_flight if step_records else 0,
        },
        "reports_dropped": {
            reason: sum(getattr(t, f"reports_dropped_{reason}") for t in step_records) for reason in UPLINK_REASONS
        },
        "agents_in_trees": {"mean": _mean(in_trees), "last_third_mean": _mean(in_trees[len(in_trees) * 2 // 3 :])},
        "trees": {"mean": _mean([t.trees for t in step_records])},
        "roots_from_densest_m": {
            "mean": _mean([t.roots_from_densest_m for t in step_records if t.roots_from_densest_m is not None])
        },
        "delta": {"mean": _mean([t.delta for t in step_records if t.delta is not None])},
        "covered_area_m2": {"mean": _mean(covered), "mean_while_trees": _mean(with_trees)},
        "transport_lost": sum(t.transport_lost for t in step_records) + sum(w.lost for w in workloads),
        "samples_rejected": sum(t.rejected for t in step_records) + sum(w.rejected for w in workloads),
        "steps": len(step_records),
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


def _mean(values: Sequence[float]) -> float | None:
    return fmean(values) if values else None


def _rate(counts: Sequence[int], step_s: float) -> float | None:
    mean = _mean(counts)
    return None if mean is None else mean / step_s
