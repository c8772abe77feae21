"""Measure runs with real processes: start-up, speed, memory, open files, and where the world's part of a step goes."""

import os
import secrets
import time
from collections.abc import Sequence
from dataclasses import replace
from statistics import median
from typing import Any

from benchmarks.rounds import median_of, memory_mb
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.doctor import check_parts_can_start
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.keys import AGENT, WORLD

AGENTS_PER_M2 = 0.0025
"""The paper's density, kept for any size of swarm (Experimental Setup)."""

MEASURED = ("startup_s", "pss_mb", "median_pss_mb", "world_pss_mb", "open_files")
"""What is measured while a run is under way."""


def bench_scenario(agents: int, steps: int) -> Scenario:
    """Make the paper's base scenario for this many agents and steps, without a recording."""
    side_m = (agents / AGENTS_PER_M2) ** 0.5
    scenario = load_scenario("paper-25", ["record=off"])
    density = replace(scenario.events.density, mean_m=(side_m / 2, side_m / 2))
    return replace(
        scenario,
        name="bench",
        run=replace(scenario.run, duration_s=steps * scenario.run.step_s),
        arena=replace(scenario.arena, width_m=side_m, height_m=side_m),
        agents=replace(scenario.agents, count=agents),
        events=replace(scenario.events, density=density, rate_hz=scenario.events.rate_hz * agents / 25),
    )


def measure(sizes: Sequence[int], steps: int, rounds: int) -> dict[str, Any]:
    """Do runs of each size; return medians of the rounds.

    Returns:
        `sizes`: a row per size with start-up time [s], steps per second, the median and the largest agent's memory and
        the world's [MB, proportional share], and the orchestrator's open files. None is what a short run left no time
        to measure. `phases`: a row per size with the world's times per step by phase, as `swarm_of_processes` says.
    """
    check_parts_can_start(max(sizes))
    results = [[swarm_of_processes(bench_scenario(agents, steps)) for agents in sizes] for _ in range(rounds)]
    medians = [median_of(rows) for rows in zip(*results, strict=True)]
    rows, phases = [], []
    for agents, row in zip(sizes, medians, strict=True):
        rows.append({"agents": agents, **{name: row[name] for name in ("steps_per_s", *MEASURED)}})
        phases.append({"agents": agents, **{name: value for name, value in row.items() if name.endswith("_us")}})
    return {"steps": steps, "rounds": rounds, "sizes": rows, "phases": phases}


def swarm_of_processes(scenario: Scenario) -> dict[str, Any]:
    """Measure one run with real processes.

    Returns:
        `steps_per_s`; `startup_s`: time until the first step; the world's times per step, by phase: wall
        time `<phase>_us`, and its main thread's CPU time `<phase>_cpu_us`. Halfway, `pss_mb` and `median_pss_mb`: the
        largest and the median agent's memory [MB]; `world_pss_mb`: the world's; `open_files`: the orchestrator's. None
        is what a short run left no time to measure.

    Raises:
        CommandError: the run is not valid.
    """
    with TemporaryFolder() as folder:
        (folder / "scenario.toml").write_text(to_toml(scenario), encoding="utf-8")
        run = f"bench-{secrets.token_hex(4)}"
        began = time.monotonic()
        measured: dict[str, float | None] = dict.fromkeys(MEASURED)
        with Swarm(scenario, run, folder) as swarm:
            with starting_processes():  # the fork server
                swarm.start_world("tcp/127.0.0.1:0", time_phases=True)
            with Observer(run, swarm.recorder_link(), None, wire=False) as observer:
                swarm.start_operator(publish_all=False)
                swarm.start_agents()
                while swarm.part(WORLD).exit_code is None:
                    observer.work(0.02)
                    phase = observer.status.phase if observer.status else "waiting"
                    if phase != "waiting" and measured["startup_s"] is None:
                        measured["startup_s"] = time.monotonic() - began
                    is_half_way = observer.status is not None and 2 * observer.status.step >= scenario.run.steps
                    if (is_half_way or phase == "ended") and measured["open_files"] is None:
                        measured |= _resources(swarm)  # while all are running and share memory
                    observer.leave_when_done()
        outcome = run_tables.read_outcome(folder)
        summary = summarise(outcome, scenario)
        if not summary["valid"]:
            raise CommandError(f"the measured run is not valid: {summary['invalid_because']}", FAILED)
        return {"steps_per_s": summary["steps_per_s"], **measured, **outcome.world["step_times"]}


def _resources(swarm: Swarm) -> dict[str, float | None]:
    agents = [mb for part in swarm.parts if part.role == AGENT and (mb := _pss_mb(part.pid)) is not None]
    return {
        "pss_mb": max(agents, default=None),
        "median_pss_mb": median(agents) if agents else None,
        "world_pss_mb": _pss_mb(swarm.part(WORLD).pid),
        "open_files": len(os.listdir("/proc/self/fd")),
    }


def _pss_mb(pid: int) -> float | None:
    """Return the proportional set size [MB] of a process: memory, with shared pages divided among their users.

    None if it has ended.
    """
    try:
        return memory_mb(f"/proc/{pid}/smaps_rollup", "Pss")
    except OSError:
        return None
