"""Rewards: each number against the step's own records, weights and signs, and functions of a user's."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from deltaswarm_learn.environment import SwarmEnv
from deltaswarm_learn.rewards import REWARDS, StepOutcome, Tally, reward_function
from deltaswarm_orchestrator.scenarios.load import load_scenario
from tests.support.learning import episode

AGENTS = ["agent_0", "agent_1"]


def outcome(**numbers: float) -> StepOutcome:
    return StepOutcome(None, None, (), dict.fromkeys(REWARDS, 0.0) | numbers)  # type: ignore[arg-type]


def test_costs_are_negative_and_weights_multiply() -> None:
    """One name, or a weighted sum; each agent gets the same."""
    happened = outcome(told=2, messages=5, untold=8.0)
    assert reward_function("told", AGENTS)(happened) == {"agent_0": 2.0, "agent_1": 2.0}
    assert reward_function("messages", AGENTS)(happened)["agent_1"] == -5.0
    assert reward_function({"told": 1, "messages": 0.1, "untold": 0.5}, AGENTS)(happened)["agent_0"] == 2 - 0.5 - 4


def test_a_function_rewards_all_or_each() -> None:
    """It gets the step's outcome; a result that is no number is refused by name."""
    assert reward_function(lambda step: step.numbers["told"], AGENTS)(outcome(told=3)) == dict.fromkeys(AGENTS, 3.0)
    assert reward_function(lambda _: {"agent_0": 1, "agent_1": 2}, AGENTS)(outcome())["agent_1"] == 2.0
    wrong: list[Any] = [None, "1", float("nan"), {"agent_0": 1.0}, {"agent_0": 1.0, "agent_1": None}, True]
    for value in wrong:
        with pytest.raises(ValueError, match=rf"the reward function must return .*{__file__}:"):
            reward_function(lambda _, value=value: value, AGENTS)(outcome())


def test_a_function_that_raises_spoils_no_episode() -> None:
    """The step is done, and the next one follows."""
    wrong = [True]

    def reward(_: StepOutcome) -> float:
        return float("nan") if wrong.pop() else 0.0

    digests = []
    for failing in (True, False):
        wrong[:] = [False, failing]
        env = SwarmEnv("smoke", {"run.duration_s": 2.0}, reward=reward)
        env.reset(seed=1)
        still = {agent: np.zeros(9, np.float32) for agent in env.agents}
        if failing:
            with pytest.raises(ValueError, match="finite numbers"):
                env.step(still)
        else:
            env.step(still)
        env.step(still)
        digests.append(env.summary()["digest"])
        with pytest.raises(RuntimeError, match="call reset"):
            env.step({})
    assert digests[0] == digests[1]


@pytest.mark.parametrize("step_s", [0.5, 2.0])
def test_each_number_is_what_the_records_say(step_s: float) -> None:
    """Over an episode, counted anew from reports and records; with a horizon that is not reached."""
    seen: list[StepOutcome] = []
    settings = {"run.step_s": step_s, "run.duration_s": 100.0, "events.rate_hz": 0.5, "events.work_agent_s": 10.0}
    env = SwarmEnv("smoke", settings, reward=lambda step: seen.append(step) or 0.0)
    for _ in episode(env, 4):
        pass
    told: set[int] = set()
    completed = 0
    for record, workload, reports, numbers in seen:
        new = {event.event for report in reports for event in report.events} - told
        told |= new
        arrived = record.events_open + record.events_completed
        assert numbers["told"] == len(new)
        assert numbers["completed"] == record.events_completed - completed
        assert numbers["untold"] == pytest.approx((arrived - len(told)) * step_s)
        assert numbers["open"] == pytest.approx(record.events_open * step_s)
        assert (numbers["messages"], numbers["frames"]) == (workload.messages, record.frames_sent)
        assert numbers["bytes"] == record.bytes_sent
        completed = record.events_completed
    totals = {name: sum(step.numbers[name] for step in seen) for name in REWARDS}
    summary = env.summary()
    assert totals["told"] == len(told) > 5
    assert totals["completed"] == summary["completed"] > 0
    assert totals["sensed"] == summary["waiting_time_s"]["n"] >= totals["worked"] >= totals["completed"]
    assert totals["messages"] == summary["reports"]["arrived"]


def test_an_event_that_is_told_after_the_horizon_is_no_reward() -> None:
    """Two events arrive at once; one is told within 10 s, the other later."""
    events = [SimpleNamespace(event=number, arrived_s=0.0, sensed_s=0, worked_s=0, completed_s=0) for number in (1, 2)]
    told_s: dict[int, float] = {}
    world = SimpleNamespace(environment=SimpleNamespace(arrived=events, changed=[]))
    swarm = SimpleNamespace(world=world, operator=SimpleNamespace(told_s=told_s))
    tally, told = Tally(load_scenario("smoke", ["metrics.horizon_s=10"])), []
    for time_s in range(20):
        told_s |= {1: 5.0} if time_s == 5 else {2: 15.0} if time_s == 15 else {}
        record = SimpleNamespace(time_s=time_s, events_open=0, frames_sent=0, bytes_sent=0)
        told.append(tally.count(swarm, record, SimpleNamespace(messages=0))["told"])  # type: ignore[arg-type]
    assert [time_s for time_s, number in enumerate(told) if number] == [5]


def test_no_event_counts_as_untold_beyond_the_horizon() -> None:
    """Agents that never report: each event counts for the horizon, as in the metric."""
    settings = {"run.duration_s": 120.0, "metrics.horizon_s": 10.0, "events.rate_hz": 0.2}
    env, sums = SwarmEnv("smoke", settings, reward="untold"), 0.0
    env.reset(seed=1)
    while env.agents:
        _, rewards, *_ = env.step({agent: np.zeros(9, np.float32) for agent in env.agents})
        sums -= rewards["agent_0"]
    summary = env.summary()
    assert summary["told_s"]["mean"] == 10.0
    followed = summary["arrivals"]["followed"]
    assert 10.0 * followed <= sums <= 10.0 * summary["arrivals"]["n"]
