"""Measure in turns, over several rounds, and tell how far the results can be trusted.

What is watched: stolen CPU time, and a floor's spread; there is no ratio on an unsteady floor.
"""

import statistics
import time
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
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

STAT = Path("/proc/stat")

STEAL = 7
"""Position of the stolen time among a CPU's counters; what follows is already counted in the first two."""

MAX_SPREAD = 0.2
"""A floor that varies more over the rounds says nothing about what stands on it."""


def cpu_ticks(file: Path = STAT) -> tuple[int, int]:
    """Return the stolen and the whole time of all CPUs since the start [ticks]."""
    counters = [int(text) for text in file.read_text(encoding="ascii").splitlines()[0].split()[1:]]
    return counters[STEAL], sum(counters[: STEAL + 1])


def stolen_share(before: tuple[int, int], after: tuple[int, int]) -> float:
    """Return the share of CPU time between two `cpu_ticks` that the host gave to others."""
    stolen, whole = (end - start for start, end in zip(before, after, strict=True))
    return stolen / whole if whole else 0.0


def spread(values: Sequence[float]) -> float:
    """Return (largest - smallest) / median."""
    return (max(values) - min(values)) / statistics.median(values)


def shares(
    values: Sequence[float], floors: Mapping[str, Sequence[float]]
) -> tuple[dict[str, float | None], str | None]:
    """Return, by floor, the median of each round's value as a share of the floor's, and why shares are missing.

    A share is None if its floor spreads by more than `MAX_SPREAD`.
    """
    unsteady = {name: spread(rounds) for name, rounds in floors.items() if spread(rounds) > MAX_SPREAD}
    medians = {
        name: None if name in unsteady else statistics.median(map(float.__truediv__, map(float, values), rounds))
        for name, rounds in floors.items()
    }
    found = ", ".join(f"{name} {share:.0%}" for name, share in unsteady.items())
    why = f"a floor must spread by at most {MAX_SPREAD:.0%} over the rounds to give a ratio (got {found})"
    return medians, why if unsteady else None


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
