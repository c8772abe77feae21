"""Rewards: the numbers of each step by name, their weighted sums, and functions of a step's record."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.checked import Problem, SettingsError, did_you_mean
from deltaswarm_wire.operator_messages import Report, Workload
from deltaswarm_wire.plugin_errors import defined_at


class StepOutcome(NamedTuple):
    """What happened in one step, for a reward: the truth, which no observation has."""

    record: StepRecord
    """The world's row of `series.csv`."""
    workload: Workload
    """The operator's counts."""
    reports: tuple[Report, ...]
    """The reports that reached the operator in this step, by agent."""
    numbers: Mapping[str, float]
    """The numbers by name, as `REWARDS` lists them, without their signs."""


REWARDS = {
    "told": (1, "events of which the operator was told for the first time, within the horizon of their arrival"),
    "sensed": (1, "events that an agent sensed for the first time"),
    "worked": (1, "events on which an agent worked for the first time"),
    "completed": (1, "events that were completed"),
    "untold": (
        -1,
        "time for which events waited to be told: their number times the step [s]; at most the horizon each",
    ),
    "open": (-1, "time for which events were open: their number times the step [s]"),
    "messages": (-1, "reports that reached the operator"),
    "frames": (-1, "radio frames that were sent"),
    "bytes": (-1, "bytes of these frames"),
}
"""The rewards of a step by name: their signs (a cost is negative), and what they count."""


class Tally:
    """Follows the events of one run, step by step."""

    def __init__(self, scenario: Scenario) -> None:
        self._step_s, self._horizon_s = scenario.run.step_s, scenario.metrics.horizon_s
        self._untold: dict[int, float] = {}
        """When each event arrived of which the operator has not been told, no longer ago than the horizon [s]."""
        self._arrived = self._reported = 0

    def count(self, swarm: InProcess, record: StepRecord, workload: Workload) -> dict[str, float]:
        """Return the numbers of the step that was closed last, by their names in `REWARDS`."""
        environment, told_s, now_s = swarm.world.environment, swarm.operator.told_s, record.time_s
        new = environment.arrived[self._arrived :]
        self._untold |= {event.event: event.arrived_s for event in new if event.arrived_s <= now_s}
        self._arrived = len(environment.arrived)
        oldest_s = now_s - self._horizon_s
        newly_told = [event for event in list(told_s)[self._reported :] if event in self._untold]
        self._reported = len(told_s)
        self._untold = {
            event: arrived_s
            for event, arrived_s in self._untold.items()
            if arrived_s > oldest_s and event not in told_s
        }
        changed = {event.event: event for event in environment.changed}.values()
        return {
            "told": len(newly_told),
            "sensed": sum(event.sensed_s == now_s for event in changed),
            "worked": sum(event.worked_s == now_s for event in changed),
            "completed": sum(event.completed_s == now_s for event in changed),
            "untold": len(self._untold) * self._step_s,
            "open": record.events_open * self._step_s,
            "messages": workload.messages,
            "frames": record.frames_sent,
            "bytes": record.bytes_sent,
        }


Reward = str | Mapping[str, float] | Callable[[StepOutcome], Any]
"""A name, weights by name, or a function of a step's outcome that returns a number or one for each agent."""


def reward_function(reward: Reward, agents: Sequence[str]) -> Callable[[StepOutcome], dict[str, float]]:
    """Return a function from a step's outcome to each agent's reward.

    Raises:
        SettingsError: a name or a weight is wrong.
    """
    if callable(reward):
        return partial(_from_function, reward, agents)
    return partial(_from_names, signed_weights(reward), agents)


def signed_weights(reward: str | Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the weights of the numbers in a reward, negative for costs. Raises SettingsError."""
    weights = {reward: 1.0} if isinstance(reward, str) else reward
    if not isinstance(weights, Mapping) or not weights:
        raise _wrong(repr(reward), "must be a name, weights by name, or a function")
    for name, weight in weights.items():
        if name not in REWARDS:
            raise _wrong(
                f"{name!r}; {did_you_mean(name, REWARDS)}".rstrip("; "), f"must be one of {', '.join(REWARDS)}"
            )
        if not _is_number(weight):
            raise _wrong(f"{weight!r} for {name!r}", "must have finite weights")
    return [(name, weight * REWARDS[name][0]) for name, weight in weights.items()]


def _wrong(given: str, must: str) -> SettingsError:
    return SettingsError([Problem("reward", given, must)])


def _from_names(signed: Sequence[tuple[str, float]], agents: Sequence[str], outcome: StepOutcome) -> dict[str, float]:
    return dict.fromkeys(agents, math.fsum(weight * outcome.numbers[name] for name, weight in signed))


def _from_function(
    function: Callable[[StepOutcome], Any], agents: Sequence[str], outcome: StepOutcome
) -> dict[str, float]:
    """Return what a user's function says of each agent. Raises ValueError if that is no number."""
    value = function(outcome)
    values = value if isinstance(value, Mapping) else dict.fromkeys(agents, value)
    if missing := [agent for agent in agents if agent not in values]:
        must = f"the reward function must return a number, or one for each agent (got none for {missing[0]})"
        raise ValueError(f"{must} ({defined_at(function)})")
    for agent in agents:
        if not _is_number(values[agent]):
            must = f"the reward function must return finite numbers (got {values[agent]!r:.80} for {agent})"
            raise ValueError(f"{must} ({defined_at(function)})")
    return {agent: float(values[agent]) for agent in agents}


def _is_number(value: Any) -> bool:
    try:
        return not isinstance(value, bool) and math.isfinite(value)
    except TypeError:
        return False
