"""Measure what a step costs in one process, and how the cost grows with the swarm, at the paper's density."""

import itertools
import statistics
import time
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from deltaswarm_orchestrator.bench.child import child
from deltaswarm_orchestrator.run.in_process import InProcess, rare_garbage_collections
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.density import ComponentSettings, DensitySettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.operator_messages import Clock

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WARM_UP_STEPS = 1000
"""Steps before the timed ones. In the paper's scenario, trees hold half of the agents from about here on."""

BLOCK_STEPS = 50
"""Scenarios take turns after this many steps, so that other load on the machine affects all of them alike."""

COUNTED = ("frames_sent", "frames_received", "agents_asked", "agents_in_trees")

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

    Raises:
        ValueError: fewer than two different sizes.
    """
    if len(set(sizes)) < 2:
        raise ValueError(f"--sizes must have at least two different sizes (got {', '.join(map(str, sizes)) or 'none'})")
    results = [[_in_fresh_process(agents, steps, seed) for agents in sizes] for seed in range(1, rounds + 1)]
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


def draw(result: dict[str, Any]) -> "Figure":
    """Draw speed and memory against the number of agents."""
    from deltaswarm_orchestrator.report.plots.benchmarks import scale

    return scale(result["sizes"])


def median_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the median of each metric over the rows in which it is not None; None if there is no such row."""
    columns = {name: [row[name] for row in rows] for rows in [list(rows)] for name in rows[0]}
    known = {name: [value for value in values if value is not None] for name, values in columns.items()}
    return {name: statistics.median(values) if values else None for name, values in known.items()}


def _in_fresh_process(agents: int, steps: int, seed: int) -> dict[str, Any]:
    with child(_send_size, agents, steps, seed) as connection:
        return dict(connection.recv())


def _send_size(connection: Connection, agents: int, steps: int, seed: int) -> None:
    connection.send(_measure_size(agents, steps, seed))


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


@rare_garbage_collections()
def in_turns(
    scenarios: Mapping[str, Scenario], steps: int, warm_up_steps: int = WARM_UP_STEPS
) -> dict[str, dict[str, float]]:
    """Measure the cost per step of each scenario in this process, after a warm-up: CPU time [us] and `COUNTED`."""
    swarms = {name: InProcess(scenario) for name, scenario in scenarios.items()}
    totals: dict[str, Counter[str]] = {name: Counter() for name in scenarios}
    turns = deque(scenarios)
    last = warm_up_steps + steps
    for first in range(0, last, BLOCK_STEPS):
        for name in turns:
            costs = _block(swarms[name], range(first, min(first + BLOCK_STEPS, last)))
            if first >= warm_up_steps:
                totals[name].update(costs)
        turns.rotate()
    return {name: {metric: total / steps for metric, total in costs.items()} for name, costs in totals.items()}


def _block(swarm: InProcess, steps: range) -> dict[str, Any]:
    """Return totals over some steps; the agents' CPU time is estimated by their share of the wall time."""
    agents_s, wall_began, began = swarm.agents_s, time.perf_counter(), time.process_time()
    step_records = []
    for step in steps:
        step_records.append(record := swarm.step(step, last=False))
        swarm.close_step(Clock(step, record.time_s, False))
    whole_us = 1e6 * (time.process_time() - began)
    agents_us = whole_us * (swarm.agents_s - agents_s) / (time.perf_counter() - wall_began)
    counts = {name: sum(getattr(record, name) for record in step_records) for name in COUNTED}
    return {"step_us": whole_us, "agents_us": agents_us, "world_us": whole_us - agents_us, **counts}


def memory_mb(file: str, name: str) -> float:
    """Return a line of a process's files in /proc, which are in KiB, in MB."""
    lines = Path(file).read_text(encoding="utf-8").splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith(f"{name}:")) / 1024
