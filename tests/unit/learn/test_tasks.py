"""Tasks for training: scenarios of many kinds, drawn by fixed seeds from streams that have none in common."""

from collections import Counter

import pytest

from deltaswarm_dense.coverage import not_covered
from deltaswarm_learn.tasks import AGENTS, MAX_LOAD, STREAMS, TRAINING, VALIDATION, WORK_AGENT_S, task
from deltaswarm_orchestrator.scenarios.load import check_table, put, read_table


@pytest.mark.parametrize("stream", STREAMS)
def test_every_task_is_a_scenario_that_the_dense_engine_covers(stream: str) -> None:
    for number in range(12):
        table = read_table("paper-25")
        for name, value in task(stream, number).items():
            assert put(table, name, value) == []
        scenario, problems = check_table(table)
        assert problems == []
        assert scenario is not None
        assert not_covered(scenario) == []
        assert scenario.events.work_agent_s == WORK_AGENT_S


def test_tasks_are_of_all_kinds() -> None:
    tasks = [task(TRAINING, number) for number in range(400)]
    kinds = Counter(len(one["events.density"].get("components", [])) for one in tasks)
    assert {0, 1, 2, 3, 4, 10} == set(kinds)
    prices = sorted(one["control.message_price"] for one in tasks)
    assert 38 <= prices.count(0.0) <= 42
    assert (prices[41] < 0.06, 0.8 < prices[220] < 1.2, prices[-1] > 19) == (True, True, True)
    jumps = sum("path_m" in part for one in tasks for part in one["events.density"].get("components", [])[:1])
    rates = sum(bool(one["events.rates_hz"]) for one in tasks)
    assert (80 < jumps < 140, 60 < rates < 140) == (True, True)
    assert {one["radio.loss"] > 0 for one in tasks} == {True, False}
    counts = [one["agents.count"] for one in tasks]
    assert (min(counts), max(counts)) == (AGENTS[0], AGENTS[1])
    assert all(one["events.rate_hz"] * WORK_AGENT_S <= 1.001 * MAX_LOAD * one["agents.count"] for one in tasks)


def test_a_task_is_the_same_whenever_it_is_drawn_and_in_no_other_stream() -> None:
    assert task(TRAINING, 7) == task(TRAINING, 7)
    seeds = {task(stream, number)["seed"] for stream in STREAMS for number in range(300)}
    assert len(seeds) == 3 * 300
    with pytest.raises(ValueError, match="must be one of training, validation, test"):
        task("tests", 0)


PINNED = [129808609, 37, 0.0294, 0.089]


def test_tasks_never_change() -> None:
    """Else a study could no longer say which tasks were trained on, and a policy could not be made again."""
    one = task(VALIDATION, 3)
    assert [one[name] for name in ("seed", "agents.count", "events.rate_hz", "control.message_price")] == PINNED
