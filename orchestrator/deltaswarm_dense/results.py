"""The records of a run, from the counts of its steps: those that world and operator make step by step."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from deltaswarm_operator.core.workload import LONG_WINDOW_S, SHORT_WINDOW_S, WorkloadMeter
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import UPLINK_REASONS, EventState, StepRecord
from deltaswarm_wire.operator_messages import Workload


def step_records(
    scenario: Scenario, counts: np.ndarray, reasons: Sequence[str], changes: Sequence[Sequence[dict[str, Any]]]
) -> list[StepRecord]:
    """Return the world's record of each step (`Bookkeeping.enter`), with what models change in it."""
    others, step_s, agents = scenario.agents.count - 1, scenario.run.step_s, scenario.agents.count
    no_frames, no_reports = dict.fromkeys(reasons, 0), dict.fromkeys(UPLINK_REASONS, 0)
    records, on_air = [], 0
    for step, row in enumerate(counts.tolist()):
        from_densest_m, asked, in_trees, roots, area_m2, sent, size, received, lost, reports, _ = row[:11]
        is_open, completed, deltas, deltas_sum = row[11:15]
        dropped = {"range": on_air * others - received - lost, "loss": lost}
        on_air = sent
        records.append(
            StepRecord(
                step=step,
                time_s=step * step_s,
                agents_alive=agents,
                agents_late=0,
                agents_asked=asked,
                agents_in_trees=in_trees,
                trees=roots,
                covered_area_m2=float(area_m2) if area_m2 >= 0 else None,
                roots_from_densest_m=None if math.isnan(from_densest_m) else from_densest_m,
                delta=deltas_sum / deltas if deltas else None,
                events_open=is_open,
                events_completed=completed,
                frames_sent=sent,
                bytes_sent=size,
                frames_received=received,
                frames_duplicated=0,
                frames_in_flight=sent * others,
                frames_dropped=no_frames | {reason: count for reason, count in dropped.items() if count},
                reports_sent=reports,
                reports_arrived=reports,
                reports_in_flight=0,
                reports_dropped=no_reports,
                rejected=0,
                transport_lost=0,
            )
        )
    for of_steps in changes:
        records = [record._replace(**change) for record, change in zip(records, of_steps, strict=True)]
    return records


def workloads(scenario: Scenario, reports: np.ndarray, first: int = 0, above: int = 0) -> list[Workload]:
    """Return the operator's record of each step from the first on (`WorkloadMeter.close_step`).

    In `above` steps before it the rate was above the threshold.
    """
    step_s, steps = scenario.run.step_s, np.arange(first, len(reports))
    short_hz, long_hz = (_rate_hz(reports, window_s, step_s, first) for window_s in (SHORT_WINDOW_S, LONG_WINDOW_S))
    above_s = (above + np.cumsum(long_hz > scenario.operator.threshold_hz)) * step_s
    columns = (steps, steps * step_s, reports[first:], reports[first:], short_hz, long_hz, above_s)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [Workload._make((*row, 0, 0, 0)) for row in rows]


def _rate_hz(reports: np.ndarray, window_s: float, step_s: float, first: int = 0) -> np.ndarray:
    """Return the rate over the last steps at each step from the first on (`SlidingRate`)."""
    window = max(1, round(window_s / step_s))
    begin = max(0, first - window)
    so_far = np.concatenate([[0], np.cumsum(reports[begin:])])
    ends = np.arange(first + 1, len(reports) + 1)
    lengths = np.minimum(ends, window)
    return (so_far[ends - begin] - so_far[ends - lengths - begin]) / (lengths * step_s)


def totals_of_operator(scenario: Scenario, counts: np.ndarray, by_agent: np.ndarray) -> dict[str, Any]:
    """Return the operator's totals of a run (`WorkloadMeter.totals`)."""
    reports = counts["reports"]
    steps, step_s, messages = len(reports), scenario.run.step_s, int(reports.sum())
    above = int((_rate_hz(reports, LONG_WINDOW_S, step_s) > scenario.operator.threshold_hz).sum())
    senders = {agent: count for agent, count in enumerate(by_agent.tolist()) if count}
    return WorkloadMeter(scenario.operator, step_s).totals | {
        "steps": steps,
        "messages": messages,
        "messages_per_s": messages / (steps * step_s) if steps else 0.0,
        "senders": len(senders),
        "news": int(counts["news"].sum()),
        "time_above_s": above * step_s,
        "per_sender": {str(agent): {"messages": count, "lost": 0, "rejected": 0} for agent, count in senders.items()},
    }


def events_of(events: np.ndarray) -> list[EventState]:
    """Return all events in order of arrival."""
    names = ("id", "x_m", "y_m", "arrived_s", "sensed_s", "worked_s", "completed_s", "work_agent_s")
    rows = (map(_none_for_nan, row) for row in zip(*(events[name].tolist() for name in names), strict=True))
    return sorted((EventState._make(row) for row in rows), key=lambda event: (event.arrived_s, event.event))


def _none_for_nan(value: float) -> float | None:
    return None if math.isnan(value) else value


def told_s(events: np.ndarray) -> dict[int, float]:
    """Return when the operator was first told of each event [s]."""
    told = events[~np.isnan(events["told_s"])]
    return dict(zip(told["id"].tolist(), told["told_s"].tolist(), strict=True))
