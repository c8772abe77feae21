"""Measure how runs with real processes grow: start-up, memory, speed and open files against the number of agents."""

from collections.abc import Sequence
from typing import Any

from deltaswarm_orchestrator.bench.rounds import cpu_ticks, stolen_share
from deltaswarm_orchestrator.bench.speed import bench_scenario, swarm_of_processes


def measure(sizes: Sequence[int], steps: int) -> dict[str, Any]:
    """Do one run of each size, smallest first.

    Returns:
        `sizes`: a row per size with start-up time [s], steps per second, the median and the largest agent's memory and
        the world's [MB, proportional share], the orchestrator's open files, and the share of CPU time stolen meanwhile.
        None is what a short run left no time to measure.

    Raises:
        CommandError: a run is not valid.
    """
    return {"steps": steps, "sizes": [_measure_size(agents, steps) for agents in sorted(sizes)]}


def _measure_size(agents: int, steps: int) -> dict[str, float | None]:
    before = cpu_ticks()
    row = swarm_of_processes(bench_scenario(agents, steps))
    return {
        "agents": agents,
        "startup_s": row["startup_s"],
        "startup_ms_per_agent": row["startup_s"] and 1e3 * row["startup_s"] / agents,
        "steps_per_s": row["swarm"],
        "agent_steps_per_s": agents * row["swarm"],
        "median_agent_pss_mb": row["median_pss_mb"],
        "largest_agent_pss_mb": row["pss_mb"],
        "world_pss_mb": row["world_pss_mb"],
        "open_files": row["open_files"],
        "stolen_share": stolen_share(before, cpu_ticks()),
    }
