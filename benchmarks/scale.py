"""Measure what a step costs in one process, and how the cost grows with the swarm, at the paper's density."""

import itertools
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.rounds import WARM_UP_STEPS, in_turns, median_of, memory_mb
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.density import ComponentSettings, DensitySettings
from deltaswarm_scenario.scenario import Scenario

TILE_AGENTS = 25
"""Number of agents of the paper's base scenario, whose arena is the tile."""


def scale_scenario(agents: int, steps: int, seed: int = 1) -> Scenario:
    """Tile copies of the paper's base scenario for this many agents, without a recording.

    Each tile has its own gaussian of events, so agents, events and trees are as dense in a large swarm as in a small
    one from the first step on. One gaussian in the middle of a larger arena would not give that.
    """
    base = load_scenario("paper-25", ["record=off"], seed)
    tiles = max(1, round(agents / TILE_AGENTS))
    rows = max(row for row in range(1, tiles + 1) if tiles % row == 0 and row * row <= tiles)
    grow = (agents / (TILE_AGENTS * tiles)) ** 0.5
    width_m, height_m = base.arena.width_m * grow, base.arena.height_m * grow
    (x_m, y_m), covariance_m2 = base.events.density.mean_m, base.events.density.covariance_m2
    components = tuple(
        ComponentSettings(1.0, (column * width_m + x_m * grow, row * height_m + y_m * grow), covariance_m2)
        for column, row in itertools.product(range(tiles // rows), range(rows))
    )
    return replace(
        base,
        name="scale",
        run=replace(base.run, duration_s=steps * base.run.step_s),
        arena=replace(base.arena, width_m=width_m * (tiles // rows), height_m=height_m * rows),
        agents=replace(base.agents, count=agents),
        events=replace(
            base.events,
            density=DensitySettings("mixture", components=components),
            rate_hz=base.events.rate_hz * agents / TILE_AGENTS,
        ),
    )


def measure(sizes: Sequence[int], steps: int, rounds: int) -> dict[str, Any]:
    """Measure the cost of a step of each size after a warm-up, in a fresh process; return medians of rounds.

    Rounds have seeds 1, 2... Costs are CPU times per step and agent, and per agent that was asked: more agents are
    asked where trees are larger, so the latter tells dearer agents from busier ones. The sizes take turns, so that
    temporary load on the machine affects all of them.
    """
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn, max_tasks_per_child=1) as pool:
        runs = [pool.submit(_measure_size, agents, steps, seed) for seed in range(1, rounds + 1) for agents in sizes]
        found = [run.result() for run in runs]
    results = [found[first : first + len(sizes)] for first in range(0, len(found), len(sizes))]
    rows = [
        {"agents": agents, "agent_steps_per_s": agents * row["steps_per_s"], **row}
        for agents, row in zip(sizes, map(median_of, zip(*results, strict=True)), strict=True)
    ]
    return {
        "warm_up_steps": WARM_UP_STEPS,
        "steps": steps,
        "rounds": rounds,
        "sizes": rows,
        "step_time_exponent": exponent(sizes, [1.0 / row["steps_per_s"] for row in rows]),
        "world_time_exponent": exponent(sizes, [row["agents"] * row["world_us_per_agent"] for row in rows]),
        "agents_time_exponent": exponent(sizes, [row["agents"] * row["agents_us_per_agent"] for row in rows]),
    }


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Return the power of the size with which a cost grows: the slope of a least-squares line through the logarithms.

    1 is a cost proportional to the number of agents.
    """
    slope, _ = np.polyfit(np.log(sizes), np.log(costs), 1)
    return float(slope)


def _measure_size(agents: int, steps: int, seed: int) -> dict[str, float | None]:
    """Measure speed, CPU times [us], shares of agents asked and in trees, and the process's peak memory [MB].

    Costs per asked agent are None if no agent was asked.
    """
    (costs,) = in_turns({"": scale_scenario(agents, WARM_UP_STEPS + steps, seed)}, steps).values()
    asked = costs["agents_asked"]
    return {
        "steps_per_s": 1e6 / costs["step_us"],
        "us_per_agent": costs["step_us"] / agents,
        "world_us_per_agent": costs["world_us"] / agents,
        "agents_us_per_agent": costs["agents_us"] / agents,
        **{
            f"{part}us_per_asked_agent": costs[f"{cost}_us"] / asked if asked else None
            for part, cost in (("", "step"), ("world_", "world"), ("agents_", "agents"))
        },
        "share_asked": asked / agents,
        "share_in_trees": costs["agents_in_trees"] / agents,
        # Not by `getrusage`, whose value starts at the parent process's.
        "peak_memory_mb": memory_mb("/proc/self/status", "VmHWM"),
    }
