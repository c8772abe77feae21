"""Measure the swarm's speed on this machine and, in turns with it, that of the bare exchange (`floors`)."""

import os
import secrets
import time
from collections.abc import Mapping
from dataclasses import replace
from statistics import median
from typing import Any

from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.bench import floors
from deltaswarm_orchestrator.bench.own_traffic import Answer, SentSample, StepTraffic, Traffic, own_traffic_steps_per_s
from deltaswarm_orchestrator.bench.rounds import cpu_ticks, in_turns, median_of, memory_mb, shares, spread, stolen_share
from deltaswarm_orchestrator.processes.launch import Swarm
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.run.observer import Observer
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.keys import ACT, AGENT, RADIO, REPORT, WORLD
from deltaswarm_wire.messages import encode_frame
from deltaswarm_wire.operator_messages import Clock, encode_clock, encode_forwarded

ROUNDS = 3
AGENTS_PER_M2 = 0.0025
"""The paper's density, kept for any size of swarm (Experimental Setup)."""

ALL_THREADS = "all_threads_cpu_us"
"""The CPU time of all threads of the world; the phases are its main thread's."""

MEASURED = ("startup_s", "pss_mb", "median_pss_mb", "world_pss_mb", "open_files")
"""What is measured while a run is under way."""


def answer(report_bytes: bytes | None, radio: bytes | None, act_bytes: bytes) -> Answer:
    """Return an agent's samples in a step: its report, then its act, attached to its radio frame if it sends one."""
    act = SentSample(ACT, len(act_bytes)) if radio is None else SentSample(RADIO, len(radio), len(act_bytes))
    return (act,) if report_bytes is None else (SentSample(REPORT, len(report_bytes)), act)


def traffic_of(scenario: Scenario) -> Traffic:
    """Return a run's traffic; the run is done in this process."""
    swarm = InProcess(scenario)
    answers: list[list[Answer]] = [[] for _ in swarm.agents]
    steps = []
    for record, _ in swarm.steps():
        given = [answer(out.report_bytes, out.radio, out.act_bytes) for _, _, out in swarm.exchanged]
        for (agent, _, _), samples in zip(swarm.exchanged, given, strict=True):
            answers[agent].append(samples)
        steps.append(
            StepTraffic(
                tuple((agent, len(encode_frame(frame))) for agent, frame, _ in swarm.exchanged),
                sum(map(len, given)),
                tuple(len(encode_forwarded(forwarded)) for forwarded in swarm.world.forwarded),
                len(encode_clock(Clock(record.step, record.time_s, swarm.world.is_last))),
            )
        )
    return Traffic(len(swarm.agents), steps, answers)


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


def measure(agents: int, steps: int) -> dict[str, Any]:
    """Make all measurements in turns; return medians of the rounds, and the largest `agent_pss_mb`.

    `own_traffic` is the floor that sends the very samples of the measured scenario. A ratio is None if its floor varied
    too much over the rounds; `no_ratio_because` then says so.

    Raises:
        CommandError: a run is not valid.
    """
    scenario = bench_scenario(agents, steps)
    traffic = traffic_of(scenario)
    began = cpu_ticks()
    rounds = []
    for _ in range(ROUNDS):
        row = swarm_of_processes(scenario)  # first, because the fork server's preloads are set only once
        row["sockets"] = floors.sockets_steps_per_s(agents, steps)
        row["zenoh"] = floors.zenoh_steps_per_s(agents, steps)
        row["own_traffic"] = own_traffic_steps_per_s(traffic)
        rounds.append(row | in_turns({"": scenario}, steps, warm_up_steps=0)[""])
    by_floor = {name: [row[name] for row in rounds] for name in ("zenoh", "own_traffic")}
    ratios, why_not = shares([row["swarm"] for row in rounds], by_floor)
    middle = median_of(rounds)
    phases = [name.removesuffix("_cpu_us") for name in middle if name.endswith("_cpu_us") and name != ALL_THREADS]
    return {
        "agents": agents,
        "steps": steps,
        "rounds": ROUNDS,
        "sockets_floor_steps_per_s": middle["sockets"],
        "zenoh_floor_steps_per_s": middle["zenoh"],
        "own_traffic_floor_steps_per_s": middle["own_traffic"],
        "swarm_steps_per_s": middle["swarm"],
        **{f"swarm_share_of_{name}_floor": ratio for name, ratio in ratios.items()},
        "no_ratio_because": why_not,
        "floor_spread": {name: spread(values) for name, values in by_floor.items()},
        "stolen_share": stolen_share(began, cpu_ticks()),
        "in_process_steps_per_s": 1e6 / middle["step_us"],
        "step_us": {
            "whole": 1e6 / middle["swarm"],
            "zenoh_floor": 1e6 / middle["zenoh"],
            "own_traffic_floor": 1e6 / middle["own_traffic"],
            "world": middle["world_us"],
            "agents": middle["agents_us"],
        },
        "world_cpu_us_all_threads": middle[ALL_THREADS],
        "world_wall_us": {phase: middle[f"{phase}_us"] for phase in phases},
        "world_cpu_us": {phase: middle[f"{phase}_cpu_us"] for phase in phases},
        "startup_s": middle["startup_s"],
        "agent_pss_mb": max((row["pss_mb"] for row in rounds if row["pss_mb"] is not None), default=None),
    }


def swarm_of_processes(scenario: Scenario) -> dict[str, Any]:
    """Measure one run with real processes.

    Returns:
        `swarm`: steps per second; `startup_s`: time until the first step; the world's times per step, by phase: wall
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
        speed = speed_of(summarise(outcome, scenario))
        return {"swarm": speed, **measured, **outcome.world["step_times"]}


def speed_of(summary: Mapping[str, Any]) -> float:
    """Return the steps per second of a run, from its summary.

    Raises:
        CommandError: the run is not valid.
    """
    if not summary.get("valid"):
        why = summary.get("invalid_because", "it has no summary")
        raise CommandError(f"the measured run is not valid: {why}", FAILED)
    return float(summary["steps_per_s"])


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
