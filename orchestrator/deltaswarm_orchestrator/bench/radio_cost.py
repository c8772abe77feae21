"""What the radio models cost a step: the plain range disc, all models off and all on, in turns, in one process."""

import statistics
import time
from collections import deque
from dataclasses import replace
from typing import Any

from deltaswarm_orchestrator.bench.scale import WARM_UP_STEPS, scale_scenario
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.run.scenario import load_scenario
from deltaswarm_wire.settings import Scenario

ALL_ON = (
    "radio.loss=0.1",
    'radio.reception="log-distance"',
    "radio.path_loss.decorrelation_m=5.0",
    "radio.ranges=[{agents=[1, 2], range_m=6.0}]",
    "radio.asymmetry.dead_share=0.05",
    "radio.asymmetry.range_factor_low=0.8",
    "radio.burst.p_good_to_bad=0.02",
    "radio.latency_s=1.0",
    "radio.jitter_s=2.0",
    "radio.duplication=0.1",
    "radio.bandwidth.sender_bytes_per_s=150.0",
    "radio.bandwidth.receiver_bytes_per_s=300.0",
    "radio.bandwidth.queue_bytes=400",
    "radio.contention_bytes_per_s=250.0",
    "radio.walls=[{a_m=[20, 5], b_m=[20, 40], from_s=50, until_s=150}]",
    "radio.jammers=[{center_m=[5, 5], radius_m=8, waypoints_m=[[35, 35]], times_s=[200]}]",
    "radio.blackouts=[{from_s=100, until_s=110}]",
)
"""As `--set` has it, with times for a run of at least 200 s and places for an arena of at least 40 m."""

ALWAYS_ON = (
    *ALL_ON,
    "radio.walls=[{a_m=[20, 5], b_m=[20, 40]}]",
    "radio.jammers=[{center_m=[5, 5], radius_m=8, waypoints_m=[[35, 35]], times_s=[5000]}]",
    "radio.blackouts=[{from_s=0, until_s=10}, {from_s=1e6}]",
)
"""The same with a wall and a moving jammer that last; a blackout that did would be the cheapest model of all."""

ALL_OFF = (
    "radio.loss=0.0",
    'radio.reception="disc"',
    "radio.ranges=[]",
    "radio.asymmetry={dead_share=0.0, range_factor_low=1.0}",
    "radio.burst.p_good_to_bad=0.0",
    "radio.latency_s=0.0",
    "radio.jitter_s=0.0",
    "radio.duplication=0.0",
    "radio.bandwidth={sender_bytes_per_s=0.0, receiver_bytes_per_s=0.0}",
    "radio.contention_bytes_per_s=0.0",
    "radio.walls=[]",
    "radio.jammers=[]",
    "radio.blackouts=[]",
)
"""Each model named, and off."""

VARIANTS = {"plain": (), "all_off": ALL_OFF, "all_on": ALWAYS_ON}

LEAST_AGENTS = 3
"""Two of them have ranges of their own."""

BLOCK_STEPS = 50
"""The variants take turns after so many steps: what else the machine does meets all of them alike."""


def radio_scenario(agents: int, steps: int, seed: int, settings: tuple[str, ...]) -> Scenario:
    """The paper's base scenario at its density for so many agents, with some settings of the radio."""
    scenario = scale_scenario(agents, steps, seed)
    return replace(scenario, radio=load_scenario("paper-25", settings).radio)


def measure_radio(agents: int, steps: int = 1000, rounds: int = 3) -> dict[str, Any]:
    """CPU time of each variant after a warm-up, in rounds with seeds 1, 2...; medians of the rounds.

    Agents that hear less have less to do, which is part of a run's speed: so the CPU time of the world and of
    all agents is given apart, with the frames sent and heard.

    Raises:
        ValueError: less than 3 agents, one step or one round.
    """
    if agents < LEAST_AGENTS or min(steps, rounds) < 1:
        raise ValueError(f"at least {LEAST_AGENTS} agents, 1 step and 1 round are expected")
    measured: dict[str, list[dict[str, float]]] = {name: [] for name in VARIANTS}
    for seed in range(1, rounds + 1):
        last = WARM_UP_STEPS + steps
        swarms = {name: InProcess(radio_scenario(agents, last, seed, table)) for name, table in VARIANTS.items()}
        blocks: dict[str, list[dict[str, float]]] = {name: [] for name in VARIANTS}
        turns = deque(VARIANTS)
        for first in range(0, last, BLOCK_STEPS):
            for name in turns:
                found = _block(swarms[name], range(first, min(first + BLOCK_STEPS, last)))
                if first >= WARM_UP_STEPS:
                    blocks[name].append(found)
            turns.rotate()
        for name, each in blocks.items():
            measured[name].append({figure: sum(block[figure] for block in each) / steps for figure in each[0]})
    return {
        "agents": agents,
        "warm_up_steps": WARM_UP_STEPS,
        "steps": steps,
        "rounds": rounds,
        "variants": {name: _median(found, measured["plain"]) for name, found in measured.items()},
    }


def _block(swarm: InProcess, steps: range) -> dict[str, float]:
    """CPU time [us] and frames of some steps; the agents' by their share of the wall time."""
    agents_s, wall_began, began = swarm.agents_s, time.perf_counter(), time.process_time()
    tallies = [swarm.step(step, last=False) for step in steps]
    whole_us = 1e6 * (time.process_time() - began)
    agents_us = whole_us * (swarm.agents_s - agents_s) / (time.perf_counter() - wall_began)
    return {
        "step_us": whole_us,
        "agents_us": agents_us,
        "world_us": whole_us - agents_us,
        "frames_sent": sum(tally.frames_sent for tally in tallies),
        "frames_received": sum(tally.frames_received for tally in tallies),
    }


def _median(rounds: list[dict[str, float]], plain: list[dict[str, float]]) -> dict[str, float]:
    """Of a variant's rounds, and of their speed by that of plain's same round."""
    medians = {name: statistics.median(one[name] for one in rounds) for name in rounds[0]}
    shares = [other["step_us"] / one["step_us"] for one, other in zip(rounds, plain, strict=True)]
    return {"steps_per_s": 1e6 / medians["step_us"], "share_of_plain": statistics.median(shares), **medians}


def text(found: dict[str, Any]) -> str:
    """For people."""
    rows = [
        f"  {name.replace('_', ' '):8s}  {row['steps_per_s']:8.0f}  {row['share_of_plain']:8.2f}"
        f"  {row['world_us']:10.0f}  {row['agents_us']:11.0f}"
        f"  {row['frames_sent']:11.1f}  {row['frames_received']:12.1f}"
        for name, row in found["variants"].items()
    ]
    return "\n".join(
        [
            f"{found['agents']} agents, {found['steps']} steps after {found['warm_up_steps']}, "
            f"{found['rounds']} rounds, medians of CPU time, one process",
            "  radio      steps/s  of plain  world [us]  agents [us]  sent a step  heard a step",
            *rows,
        ]
    )
