"""Costs of runs at a price of messages, and the delay of events after a change."""

import math
import tomllib
from typing import Any

import pandas as pd
import pytest

from deltaswarm_learn.costs import cost_of
from deltaswarm_orchestrator.scenarios.load import check_table
from deltaswarm_orchestrator.sweeps.job import Task, work
from deltaswarm_orchestrator.sweeps.table import row_of, series_of
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.costs import cost_s, with_costs
from deltaswarm_studies.metrics import MetricSettings
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import runs_of
from deltaswarm_wire import checked
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import OWN, SWEEP, made

RUN: dict[str, Any] = {
    "events": {
        "arrived_s": [10.0, 100.0, 150.0, 179.0],
        "told_s": [30.0, 150.0, None, 181.0],
        "completed_s": [70.0, None, None, 183.0],
    },
    "summary": {"operator": {"messages": 10}},
}
"""Of 200 s. The events' delays are 40, 75, 50 and 3 s."""

JUMPS = """
rate_hz = 0.1
density = { kind = "mixture", components = [
    { path_m = [[5.0, 5.0], [5.0, 5.0], [9.0, 9.0]], path_s = [0.0, 100.0, 100.0] },
    { mean_m = [10.0, 10.0] },
] }
"""


def cost(events: str = "", result: dict[str, Any] = RUN, **keys: Any) -> float:
    given = {"schema": 1, "run": {"duration_s": 200.0}, "events": tomllib.loads(events)}
    scenario, problems = check_table(given)
    assert isinstance(scenario, Scenario), problems
    metric = checked.load(MetricSettings, {"name": "cost", "kind": "cost"} | keys).metric()
    return cost_s(metric, scenario, result)


def test_a_message_costs_its_price() -> None:
    """Ten messages for four events: 2.5 each."""
    assert cost() == pytest.approx(168.0 / 4)
    assert cost(price_s=0.3) == pytest.approx(42.0 + 0.75)
    assert math.isnan(cost(result={**RUN, "events": None}))


@pytest.mark.parametrize(
    "events", ["rate_hz = 0.1\nrates_hz = [0.2, 0.1]\nrates_s = [100.0, 160.0]", JUMPS], ids=["rate", "places"]
)
def test_only_events_after_a_change_count(events: str) -> None:
    """It is at 100 s, and the event that arrives then is after it."""
    assert cost(events, after_change=True) == pytest.approx(128.0 / 3)
    assert cost(events, after_change=True, until_s=50.0) == 75.0
    assert cost(events, after_change=True, from_s=50.0, until_s=60.0) == 50.0
    assert math.isnan(cost(events, after_change=True, from_s=90.0))
    assert math.isnan(cost("rate_hz = 0.1", after_change=True))


def test_a_place_that_moves_slowly_changes_nothing_at_once() -> None:
    assert math.isnan(cost(JUMPS.replace("0.0, 100.0, 100.0", "0.0, 50.0, 100.0"), after_change=True))


@pytest.mark.parametrize(
    ("keys", "where"),
    [
        ({"price_s": 1.0, "until_s": 9.0}, "price_s"),
        ({"from_s": 9.0, "until_s": 9.0}, "until_s"),
        ({"kind": "column", "column": "completed", "price_s": 1.0}, "price_s"),
        ({"kind": "column", "column": "completed", "after_change": True}, "after_change"),
    ],
)
def test_impossible_costs_are_refused(keys: dict[str, Any], where: str) -> None:
    with pytest.raises(SettingsError, match=where):
        cost(**keys)


COSTS = '[[metric]]\nname = "cost_2"\nkind = "cost"\nprice_s = 2.0\n'


def test_a_study_without_a_change_has_no_time_after_it() -> None:
    with pytest.raises(SettingsError, match="after_change"):
        made(OWN + COSTS.replace("price_s = 2.0", "after_change = true"))


def costly(sweep: str = SWEEP) -> Study:
    return made(OWN.replace('"messages"', '"messages", "cost_2"').replace('"waiting_all", ', "") + COSTS, sweep)


def test_runs_have_their_costs() -> None:
    """In the table's order; a price is on the page by the metric's title."""
    study = costly(SWEEP.replace("1000.0", "200.0"))
    jobs = list(study.sweep.jobs())[:2]
    results = [RUN, {**RUN, "summary": {"operator": {"messages": 20}}}]
    rows = [{"variant": job.variant.label, "replicate": job.replicate, "seed": job.scenario.seed} for job in jobs]
    table = pd.DataFrame(rows).assign(**{"operator_messages_per_s.mean": 1.0})
    runs = list(zip(jobs, results, strict=True))
    found = runs_of(study, with_costs(study, table, runs), pd.DataFrame())
    assert [*found["cost_2"]] == [47.0, 52.0]
    assert study.metrics["cost_2"].label == "Mean delay of an event, plus 2 s a message [s]"


def test_a_run_costs_what_training_says() -> None:
    """The same run, by the same engine: 300 s of three agents."""
    keys = {"run.duration_s": 300.0, "agents.count": 3, "events.rate_hz": 0.1, "seed": 5}
    sweep = SWEEP.replace('"smoke"', '"paper-25"').replace("metrics.horizon_s = 100.0", "agents.count = 3")
    sweep = sweep.replace("1000.0", "300.0\nevents.rate_hz = 0.1\nmetrics.horizon_s = 100.0")
    study = costly(sweep)
    job = next(job for job in study.sweep.jobs() if job.variant.label == "loss=0.0, hybrid 3")
    run = [(job, work(Task(job)))]
    expected = cost_of({**keys, "seed": job.scenario.seed}, (), {"mode": "hybrid"})
    row = runs_of(study, with_costs(study, row_of(*run[0]), run), series_of(run)).iloc[0]
    assert row["cost_2"] == pytest.approx(expected.at(2.0), rel=1e-12)
    assert expected.messages > 0
