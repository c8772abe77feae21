"""Measure what the radio models cost a step: the plain range disc and all models on, in turns, in one process."""

from dataclasses import replace
from typing import Any

from benchmarks.rounds import WARM_UP_STEPS, in_turns, median_of
from benchmarks.scale import scale_scenario
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario

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
"""Settings as for `--set`, with times for a run of at least 200 s and positions for an arena of at least 40 m."""

ALWAYS_ON = (
    *ALL_ON,
    "radio.walls=[{a_m=[20, 5], b_m=[20, 40]}]",
    "radio.jammers=[{center_m=[5, 5], radius_m=8, waypoints_m=[[35, 35]], times_s=[5000]}]",
    "radio.blackouts=[{from_s=0, until_s=10}, {from_s=1e6}]",
)
"""The same with a wall and a moving jammer that last. No blackout lasts: it would be the cheapest model of all."""

VARIANTS = {"plain": (), "all_on": ALWAYS_ON}


def radio_scenario(agents: int, steps: int, seed: int, settings: tuple[str, ...]) -> Scenario:
    """Make the paper's base scenario at its density for this many agents, with some settings of the radio."""
    scenario = scale_scenario(agents, steps, seed)
    return replace(scenario, radio=load_scenario("paper-25", settings).radio)


def measure(agents: int, steps: int, rounds: int) -> dict[str, Any]:
    """Measure the CPU time of each variant after a warm-up, in rounds with seeds 1, 2...; return medians of the rounds.

    Agents that hear less have less to do, which is part of a run's speed. Therefore the CPU time of the world and of
    all agents is given separately, with the frames sent and received. There must be an agent 2, which has a range of
    its own.
    """
    last = WARM_UP_STEPS + steps
    results = []
    for seed in range(1, rounds + 1):
        scenarios = {name: radio_scenario(agents, last, seed, settings) for name, settings in VARIANTS.items()}
        result = in_turns(scenarios, steps)
        plain_us = result["plain"]["step_us"]
        results.append({name: {"share_of_plain": plain_us / row["step_us"], **row} for name, row in result.items()})
    medians = {name: median_of(result[name] for result in results) for name in VARIANTS}
    return {
        "agents": agents,
        "warm_up_steps": WARM_UP_STEPS,
        "steps": steps,
        "rounds": rounds,
        "variants": {name: {"steps_per_s": 1e6 / row["step_us"], **row} for name, row in medians.items()},
    }
