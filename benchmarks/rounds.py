"""Measure scenarios in turns in this process, and take medians over rounds."""

import statistics
import time
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.run.in_process import InProcess, Step, rare_garbage_collections
from deltaswarm_scenario.scenario import Scenario

WARM_UP_STEPS = 1000
"""Steps before the timed ones. In the paper's scenario, trees hold half of the agents from about here on."""

BLOCK_STEPS = 50
"""Scenarios take turns after this many steps, so that other load on the machine affects all of them alike."""

COUNTED = ("frames_sent", "frames_received", "agents_asked", "agents_in_trees")


def median_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the median of each metric over the rows in which it is not None; None if there is no such row."""
    columns = {name: [row[name] for row in rows] for rows in [list(rows)] for name in rows[0]}
    known = {name: [value for value in values if value is not None] for name, values in columns.items()}
    return {name: statistics.median(values) if values else None for name, values in known.items()}


@rare_garbage_collections()
def in_turns(
    scenarios: Mapping[str, Scenario], steps: int, warm_up_steps: int = WARM_UP_STEPS
) -> dict[str, dict[str, float]]:
    """Measure the cost per step of each scenario in this process, after a warm-up: CPU time [us] and `COUNTED`."""
    swarms = {name: InProcess(scenario) for name, scenario in scenarios.items()}
    totals: dict[str, Counter[str]] = {name: Counter() for name in scenarios}
    turns = deque(scenarios)
    last = warm_up_steps + steps
    all_steps = {name: swarm.steps(last) for name, swarm in swarms.items()}
    for first in range(0, last, BLOCK_STEPS):
        for name in turns:
            costs = _block(swarms[name], islice(all_steps[name], min(BLOCK_STEPS, last - first)))
            if first >= warm_up_steps:
                totals[name].update(costs)
        turns.rotate()
    return {name: {metric: total / steps for metric, total in costs.items()} for name, costs in totals.items()}


def _block(swarm: InProcess, steps: Iterable[Step]) -> dict[str, Any]:
    """Return totals over some steps; the agents' CPU time is estimated by their share of the wall time."""
    agents_s, wall_began, began = swarm.agents_s, time.perf_counter(), time.process_time()
    step_records = [step.record for step in steps]
    whole_us = 1e6 * (time.process_time() - began)
    agents_us = whole_us * (swarm.agents_s - agents_s) / (time.perf_counter() - wall_began)
    counts = {name: sum(getattr(record, name) for record in step_records) for name in COUNTED}
    return {"step_us": whole_us, "agents_us": agents_us, "world_us": whole_us - agents_us, **counts}


def memory_mb(file: str, name: str) -> float:
    """Return a line of a process's files in /proc, which are in KiB, in MB."""
    lines = Path(file).read_text(encoding="utf-8").splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith(f"{name}:")) / 1024
