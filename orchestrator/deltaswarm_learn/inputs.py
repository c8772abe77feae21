"""Which inputs of a learned rule decide: what it would do if one were permuted, or the same everywhere.

What agents could decide by is noted in runs of validation tasks by the Python engine, every 30 s of each agent.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deltaswarm_agent.controllers.paper.controller import PaperController
from deltaswarm_agent.controllers.paper.policy import FAR_DELTA, FIRST_DELTA, GAIN, INPUTS, LEAST_DELTA, outputs
from deltaswarm_agent.controllers.paper.states import ATTENDING
from deltaswarm_learn.costs import Keys, scenario_of
from deltaswarm_learn.tasks import VALIDATION, task
from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process
from deltaswarm_scenario.scenario import Scenario

Floats = NDArray[np.float64]

EVERY_S = 30.0

PERMUTATIONS = 20

LOW, HIGH = 0.1, 0.9
"""Quantiles of an input at which the rule's choices are told."""


class Influence(NamedTuple):
    """What an input does to the choices of a rule: delta, and the share of agents that work outside trees."""

    input: str
    delta: float
    """Mean change of delta if the input is permuted among the decisions."""
    working: float
    """The same of the share that works."""
    delta_at: tuple[float, float]
    """Mean delta if the input has its value of 10 %, and of 90 %, in all decisions (partial dependence)."""
    working_at: tuple[float, float]


def noted(numbers: Sequence[int], overrides: Sequence[str], control: Keys) -> Floats:
    """Do validation tasks under a learned rule; return what agents decide by: (decisions, inputs)."""
    scenarios = [scenario_of(task(VALIDATION, number), overrides, control) for number in numbers]
    return np.array([row for scenario in scenarios for row in _inputs_in(scenario)])


def _inputs_in(scenario: Scenario) -> list[tuple[float, ...]]:
    rows: list[tuple[float, ...]] = []
    every = max(1, round(EVERY_S / scenario.run.step_s))

    def note(swarm: InProcess, step: int) -> None:
        if not step or step % every:
            return
        agents = [core.controller.agent for core in swarm.agents if isinstance(core.controller, PaperController)]
        rows.extend(
            agent.experience.inputs(agent.finds, agent.state is ATTENDING, agent.price_s, step)
            for agent in agents
            if agent.experience is not None and agent.finds is not None
        )

    run_in_process(scenario, before=note)
    return rows


def influences(weights: Sequence[float], inputs: Floats) -> Iterator[Influence]:
    """Yield the influence of each input, by permutations with seed 0."""
    drawn = np.random.default_rng(0)
    as_they_are = _chosen(weights, inputs)

    def with_values(place: int, values: Floats | float) -> Floats:
        changed = inputs.copy()
        changed[:, place] = values
        return _chosen(weights, changed)

    for place, name in enumerate(INPUTS):
        permuted = [with_values(place, drawn.permutation(inputs[:, place])) for _ in range(PERMUTATIONS)]
        delta, working = np.mean([np.abs(one - as_they_are).mean(axis=1) for one in permuted], axis=0).tolist()
        ends = np.quantile(inputs[:, place], (LOW, HIGH)).tolist()
        low, high = (with_values(place, end).mean(axis=1).tolist() for end in ends)
        yield Influence(name, delta, working, (low[0], high[0]), (low[1], high[1]))


def _chosen(weights: Sequence[float], inputs: Floats) -> Floats:
    """Return delta, where `FAR_DELTA` is never, and the share of agents that work: (2, decisions)."""
    delta, working = outputs(weights, list(inputs.T))  # sums of arrays as well
    return np.stack([np.clip(FIRST_DELTA + GAIN * delta, LEAST_DELTA, FAR_DELTA), np.clip(1.0 + working, 0.0, 1.0)])


def table_of(found: Sequence[Influence]) -> str:
    """Return influences as a Markdown table, the strongest on delta first."""
    lines = [
        "| input | delta, permuted | at 10 % and 90 % | working, permuted | at 10 % and 90 % |",
        "| --- | --- | --- | --- | --- |",
    ]
    for one in sorted(found, key=lambda one: -one.delta):
        low, high = one.delta_at
        few, many = one.working_at
        cells = f"{one.delta:.2f} | {low:.1f}, {high:.1f} | {one.working:.2f} | {few:.2f}, {many:.2f}"
        lines.append(f"| `{one.input}` | {cells} |")
    return "\n".join(lines)
