"""Measure what bodies cost a step: points, discs and quadcopters, in turns, in one process."""

from dataclasses import replace
from typing import Any

from benchmarks.rounds import WARM_UP_STEPS, in_turns, median_of
from benchmarks.scale import scale_scenario
from deltaswarm_orchestrator.scenarios.load import load_scenario

WORLDS = {
    "points": [],
    "discs": ['world.dynamics="physics"', "world.radius_m=0.25"],
    "quadcopters": ['world.dynamics="jsbsim"'],
    "quadcopters in gusts": ['world.dynamics="jsbsim"', "world.wind_mps=5", "world.gust_mps=2"],
}


def measure(agents: int, steps: int, rounds: int) -> dict[str, Any]:
    """Measure the CPU time of a step of 1 s after a warm-up, in rounds with seeds 1, 2...; return their medians."""
    results = []
    for seed in range(1, rounds + 1):
        base = scale_scenario(agents, WARM_UP_STEPS + steps, seed)
        worlds = {name: load_scenario("paper-25", sets).world for name, sets in WORLDS.items()}
        results.append(in_turns({name: replace(base, world=world) for name, world in worlds.items()}, steps))
    rows = {name: median_of(result[name] for result in results) for name in WORLDS}
    return {"agents": agents, "warm_up_steps": WARM_UP_STEPS, "steps": steps, "rounds": rounds, "bodies": rows}
