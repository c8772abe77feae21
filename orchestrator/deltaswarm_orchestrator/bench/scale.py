"""How the time of a step grows with the swarm, at the paper's density, in one process."""

import itertools
import multiprocessing
import statistics
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.run.launch import bare_main_module, safe_path
from deltaswarm_orchestrator.run.scenario import load_scenario
from deltaswarm_wire.operator_messages import Clock
from deltaswarm_wire.settings import ComponentSettings, DensitySettings, Scenario

SIZES = (25, 50, 100, 200, 400)

WARM_UP_STEPS = 1000
"""Steps before those that are timed. In the paper's scenario trees hold half of the agents from about here on."""

TILE_AGENTS = 25
"""Agents of the paper's base scenario, whose arena is the tile."""


def scale_scenario(agents: int, steps: int, seed: int = 1) -> Scenario:
    """The paper's base scenario side by side as often as so many agents need, without a recording.

    Each tile has its own gaussian of events: agents, events and trees are as dense in a large swarm as in a
    small one, from the first step on, which one gaussian in the middle of a larger arena would not give.
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


def measure_scale(sizes: Sequence[int] = SIZES, steps: int = 1000, rounds: int = 3) -> dict[str, Any]:
    """Steps/s of each size after a warm-up, medians of rounds with seeds 1, 2...; each in a fresh process.

    The sizes take turns, so that a machine that is busy for a while is so for all of them.

    Raises:
        ValueError: a size, the steps or the rounds are below 1, or there are not two different sizes.
    """
    if min(steps, rounds, *sizes) < 1:
        raise ValueError("sizes, steps and rounds of at least 1 are expected")
    if len(set(sizes)) < 2:
        raise ValueError("at least two different sizes are expected: growth is between them")
    found = [[_in_fresh_process(agents, steps, seed) for agents in sizes] for seed in range(1, rounds + 1)]
    rows = []
    for agents, measured in zip(sizes, zip(*found, strict=True), strict=True):
        median = {name: statistics.median(one[name] for one in measured) for name in measured[0]}
        rows.append({"agents": agents, "agent_steps_per_s": agents * median["steps_per_s"], **median})
    step_s = [1.0 / row["steps_per_s"] for row in rows]
    exponent, _ = np.polyfit(np.log(sizes), np.log(step_s), 1)
    return {
        "warm_up_steps": WARM_UP_STEPS,
        "steps": steps,
        "rounds": rounds,
        "sizes": rows,
        "step_time_exponent": float(exponent),
    }


def _in_fresh_process(agents: int, steps: int, seed: int) -> dict[str, float]:
    context = multiprocessing.get_context("spawn")
    with safe_path(), bare_main_module(), ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(_measure, agents, steps, seed).result()


def _measure(agents: int, steps: int, seed: int) -> dict[str, float]:
    """Speed, the share of agents in trees while it was measured, and the process's largest memory [MB]."""
    swarm = InProcess(scale_scenario(agents, WARM_UP_STEPS + steps, seed))
    in_trees = 0
    began = time.process_time()
    for step in range(WARM_UP_STEPS + steps):
        if step == WARM_UP_STEPS:
            began = time.process_time()
        tally = swarm.step(step, step == WARM_UP_STEPS + steps - 1)
        swarm.close(Clock(step, tally.time_s, False))
        in_trees += tally.agents_in_trees if step >= WARM_UP_STEPS else 0
    return {
        "steps_per_s": steps / (time.process_time() - began),
        "share_in_trees": in_trees / (steps * agents),
        "peak_memory_mb": _peak_memory_mb(),
    }


def _peak_memory_mb() -> float:
    """Not `getrusage`: its figure begins with that of the process that started this one."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024


def text(found: dict[str, Any]) -> str:
    """For people."""
    head = f"{found['steps']} steps after {found['warm_up_steps']}, medians of {found['rounds']} rounds, one process"
    rows = [
        f"  {row['agents']:6d}  {row['steps_per_s']:8.0f}  {row['agent_steps_per_s']:13.0f}"
        f"  {row['share_in_trees']:8.2f}  {row['peak_memory_mb']:9.0f}"
        for row in found["sizes"]
    ]
    return "\n".join(
        [
            head,
            "  agents   steps/s  agent-steps/s  in trees  peak [MB]",
            *rows,
            f"  the time of a step grows with the number of agents to the power of {found['step_time_exponent']:.2f}",
        ]
    )
