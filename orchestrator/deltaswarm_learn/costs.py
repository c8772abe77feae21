"""What a run costs at a price of messages, by the dense engine.

A run costs the mean delay of its events plus the price times the messages per event.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from deltaswarm_dense.compiled import compile_once
from deltaswarm_dense.engine import run_dense
from deltaswarm_learn.tasks import BASE, VALIDATION, task
from deltaswarm_orchestrator.results.outcome import delay_s
from deltaswarm_orchestrator.scenarios.load import apply, check_table, put, read_table
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, SettingsError, plain
from deltaswarm_wire.plugins import controller_settings
from deltaswarm_wire.settings import ControlSettings

Keys = Mapping[str, Any]

WITHOUT_DELTA = "decentralised", "hierarchical"
"""Modes that accept a rule for delta, and do not use it."""


class Cost(NamedTuple):
    """What a run costs at any price."""

    delay_s: float
    """Mean over the events; 0 without any."""
    messages: float
    """Messages to the operator per event."""

    def at(self, price_s: float) -> float:
        """Return the cost at a price of a message [s]."""
        return self.delay_s + price_s * self.messages


def cost_of(keys: Keys, overrides: Sequence[str], control: Keys) -> Cost:
    """Do a run of the base scenario with other keys under a control (`scenario_of`)."""
    compile_once("dense engine", lambda: run_dense(Scenario()))
    scenario = scenario_of(keys, overrides, control)
    outcome, end_s = run_dense(scenario), scenario.run.steps * scenario.run.step_s
    told_s = outcome.told_s or {}
    delays_s = [delay_s(event.arrived_s, told_s.get(event.event), event.completed_s, end_s) for event in outcome.events]
    messages = sum(workload.messages for workload in outcome.workloads)
    count = max(1, len(delays_s))
    return Cost(math.fsum(delays_s) / count, messages / count)


def scenario_of(keys: Keys, overrides: Sequence[str], control: Keys) -> Scenario:
    """Return the base scenario with other keys under a control.

    Args:
        keys: keys of the scenario by dotted names.
        overrides: more of them, as `key=value`.
        control: keys of the table `control`, such as mode.

    Raises:
        SettingsError: keys are wrong.
    """
    table = read_table(BASE)
    problems = [problem for name, value in keys.items() for problem in put(table, name, value)]
    problems += [problem for override in overrides for problem in apply(table, override)]
    scenario, more = check_table(table)
    if scenario is None or problems + more:
        raise SettingsError(problems + more)
    own = table["control"] | dict(control)
    mode = own.pop("mode")
    made = plain(controller_settings(mode, own, scenario.for_agent(0)))
    return replace(scenario, control=ControlSettings(mode, made))


def check_rule(overrides: Sequence[str]) -> None:
    """Check that agents use a learned rule in tasks with these keys.

    Raises:
        SettingsError: they do not, or the keys are wrong.
    """
    mode = scenario_of(task(VALIDATION, 0), overrides, {"delta_rule": "learned"}).control.mode
    if mode in WITHOUT_DELTA:
        raise SettingsError([Problem("control.mode", repr(mode), "must be one that chooses delta, such as hybrid")])
