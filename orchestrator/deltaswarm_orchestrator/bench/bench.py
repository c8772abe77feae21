"""How fast the swarm is on this machine, beside the floors under it, measured in turns in one run."""

import secrets
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.bench import floors
from deltaswarm_orchestrator.run import results
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.run.launch import Swarm
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.run.scenario import load_scenario, to_toml
from deltaswarm_wire.keys import AGENT, WORLD
from deltaswarm_wire.settings import Scenario

ROUNDS = 3
AGENTS_PER_M2 = 0.0025
"""The paper's density, kept for any size of swarm (Experimental Setup)."""


def bench_scenario(agents: int, steps: int) -> Scenario:
    """The paper's base scenario for so many agents, without a recording."""
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


def measure(agents: int, steps: int) -> dict[str, Any]:
    """All measurements, in turns; medians of the rounds.

    Raises:
        ValueError: less than one agent or one step.
    """
    if agents < 1 or steps < 1:
        raise ValueError(f"at least 1 agent and 1 step are expected, not {agents} and {steps}")
    scenario = bench_scenario(agents, steps)
    sockets, zenoh, swarm, inside, parts = [], [], [], [], []
    started: list[float] = []
    memory: list[float] = []
    for _ in range(ROUNDS):
        rate, startup_s, pss_mb = _swarm(scenario)  # first: what the fork server preloads is decided once
        swarm.append(rate)
        started.append(startup_s)
        memory.append(pss_mb)
        sockets.append(floors.sockets_steps_per_s(agents, steps))
        zenoh.append(floors.zenoh_steps_per_s(agents, steps))
        rate, shares = _in_process(scenario)
        inside.append(rate)
        parts.append(shares)
    ratios = [one / floor for one, floor in zip(swarm, zenoh, strict=True)]
    agents_us = statistics.median(share["agents_us"] for share in parts)
    world_us = statistics.median(share["world_us"] for share in parts)
    step_us = 1e6 / statistics.median(swarm)
    return {
        "agents": agents,
        "steps": steps,
        "rounds": ROUNDS,
        "sockets_floor_steps_per_s": statistics.median(sockets),
        "zenoh_floor_steps_per_s": statistics.median(zenoh),
        "swarm_steps_per_s": statistics.median(swarm),
        "swarm_share_of_zenoh_floor": statistics.median(ratios),
        "in_process_steps_per_s": statistics.median(inside),
        "step_us": {
            "whole": step_us,
            "zenoh_floor": 1e6 / statistics.median(zenoh),
            "world": world_us,
            "agents": agents_us,
        },
        "startup_s": statistics.median(started),
        "agent_pss_mb": max(memory),
    }


def _swarm(scenario: Scenario) -> tuple[float, float, float]:
    """Steps per second, start-up time [s] and the largest agent's memory [MB] of one run with processes."""
    with tempfile.TemporaryDirectory(prefix="deltaswarm-bench-") as name:
        folder = Path(name)
        (folder / "scenario.toml").write_text(to_toml(scenario))
        run = f"bench-{secrets.token_hex(4)}"
        began = time.monotonic()
        startup_s = pss_mb = 0.0
        with Swarm(scenario, run, folder) as swarm:
            swarm.start_world(folder / "scenario.toml", listen="tcp/127.0.0.1:0", record=False)
            with Observer(run, swarm.recorder_link(), None, wire=False) as observer:
                swarm.start_operator(publish_all=False)
                swarm.start_agents()
                while swarm.part(WORLD).exit_code is None:
                    observer.work(0.02)
                    phase = observer.status.phase if observer.status else "waiting"
                    if phase != "waiting" and not startup_s:
                        startup_s = time.monotonic() - began
                    is_half_way = observer.status is not None and 2 * observer.status.step >= scenario.run.steps
                    if is_half_way and not pss_mb:  # while all are there: who leaves shares no more
                        pss_mb = max(_pss_mb(p.pid) for p in swarm.parts if p.role == AGENT)
                    observer.leave_when_done()
        summary = results.summary(results.read_outcome(folder), scenario)
        if not summary["valid"]:
            raise RuntimeError(f"the measured run is not valid: {summary['invalid_because']}")
        return summary["steps_per_s"], startup_s, pss_mb


def _pss_mb(pid: int) -> float:
    """Proportional set size: memory, with what is shared counted by its share [MB]."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


def _in_process(scenario: Scenario) -> tuple[float, dict[str, float]]:
    """Steps per second in one process, and where the time goes [us per step]."""
    swarm = InProcess(scenario)
    steps = scenario.run.steps
    began = time.perf_counter()
    for step in range(steps):
        swarm.step(step, step == steps - 1)
    wall_s = time.perf_counter() - began
    agents_us = swarm.agents_s / steps * 1e6
    return steps / wall_s, {"agents_us": agents_us, "world_us": wall_s / steps * 1e6 - agents_us}


def text(found: dict[str, Any]) -> str:
    """For people."""
    step = found["step_us"]
    fabric = min(step["zenoh_floor"], step["whole"])
    return "\n".join(
        [
            f"{found['agents']} agents, {found['steps']} steps, medians of {found['rounds']} rounds",
            f"  sockets floor      {found['sockets_floor_steps_per_s']:8.0f} steps/s",
            f"  Zenoh floor        {found['zenoh_floor_steps_per_s']:8.0f} steps/s",
            f"  swarm              {found['swarm_steps_per_s']:8.0f} steps/s  "
            f"({found['swarm_share_of_zenoh_floor']:.2f} of the Zenoh floor)",
            f"  one process        {found['in_process_steps_per_s']:8.0f} steps/s",
            f"  a step             {step['whole']:8.0f} us: fabric {fabric:.0f}, the rest {step['whole'] - fabric:.0f}",
            f"  on one core        {step['world']:8.0f} us world, {step['agents']:.0f} us all agents",
            f"  start-up           {found['startup_s']:8.2f} s",
            f"  memory per agent   {found['agent_pss_mb']:8.1f} MB (PSS, largest)",
        ]
    )
