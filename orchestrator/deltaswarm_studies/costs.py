"""What runs cost at a price of messages, or while something has just changed: metrics of single events."""

import math
from statistics import fmean

import pandas as pd

from deltaswarm_orchestrator.results.outcome import delay_s
from deltaswarm_orchestrator.sweeps.job import Result
from deltaswarm_orchestrator.sweeps.table import Finished
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.checks import used_metrics
from deltaswarm_studies.event_checks import first_change_s
from deltaswarm_studies.metrics import COST, StudyMetric
from deltaswarm_studies.study import Study


def with_costs(study: Study, table: pd.DataFrame, runs: Finished) -> pd.DataFrame:
    """Add to a sweep's table, which has a row for each of these runs, a column for each cost that the study uses."""
    used = [metric for name in used_metrics(study) if (metric := study.metrics[name]).kind == COST]
    costs = {metric.column: [cost_s(metric, job.scenario, result) for job, result in runs] for metric in used}
    return table.assign(**costs)


def cost_s(metric: StudyMetric, scenario: Scenario, result: Result) -> float:
    """Return what a run costs [s]; NaN if there is nothing that it could cost, or if its events were not kept."""
    begin_s = first_change_s(scenario.events) if metric.after_change else 0.0
    events, end_s = result.get("events"), scenario.run.steps * scenario.run.step_s
    if not events or begin_s is None:
        return math.nan
    moments = zip(events["arrived_s"], events["told_s"], events["completed_s"], strict=True)
    delays_s = [
        delay_s(arrived_s, told_s, completed_s, end_s)
        for arrived_s, told_s, completed_s in moments
        if metric.from_s <= arrived_s - begin_s < metric.until_s
    ]
    if not delays_s:
        return math.nan
    messages: int = result["summary"]["operator"]["messages"]
    return fmean(delays_s) + metric.price_s * messages / len(delays_s)
