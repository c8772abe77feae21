"""Measure how a command spreads: the share of agents that know it, against the time since it was sent."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.operator_links import CommandSettings
from deltaswarm_scenario.scenario import Scenario

RANGES_M = (20.0, 50.0, None)
"""Ranges of the base, which is in the middle of the arena; None: the base is heard everywhere."""
LOSSES = (0.0, 0.3, 0.6)
"""Shares of frames lost, of the base's and of the agents'."""
SENT_S, WATCHED_S = 60.0, 180.0
"""The command is sent after the swarm has spread out [s], and lives for as long as it is watched [s]."""


def coverage_scenario(range_m: float | None, loss: float, seed: int) -> Scenario:
    """Make the paper's base scenario with one command for all agents."""
    base = load_scenario("paper-25", ["record=off"], seed)
    command = CommandSettings(SENT_S, "set delta", arguments={"delta": 4}, life_s=WATCHED_S)
    middle_m = (base.arena.width_m / 2, base.arena.height_m / 2)
    return replace(
        base,
        name="coverage",
        run=replace(base.run, duration_s=SENT_S + WATCHED_S),
        radio=replace(base.radio, loss=loss),
        downlink=replace(base.downlink, base_m=middle_m, range_m=range_m, loss=loss),
        command=(command,),
    )


def measure(rounds: int = 20, ranges_m: Sequence[float | None] = RANGES_M) -> dict[str, Any]:
    """Measure the mean share of agents that know the command over time, in one process, with seeds 1 to `rounds`.

    Returns:
        `rows`, one for each range of the base and loss, with `share_known`, an entry per step.
    """
    rows = [
        {
            "range_m": range_m,
            "loss": loss,
            "share_known": np.mean([_shares(range_m, loss, seed) for seed in range(1, rounds + 1)], axis=0).tolist(),
        }
        for range_m in ranges_m
        for loss in LOSSES
    ]
    return {"rounds": rounds, "step_s": coverage_scenario(None, 0.0, 1).run.step_s, "rows": rows}


def brief(result: dict[str, Any]) -> dict[str, Any]:
    """Return, instead of each row's shares, the time until half and nine tenths of the agents know the command."""
    rows = []
    for row in result["rows"]:
        shares = row["share_known"]
        times_s = {
            f"{share:.0%}_know_after_s": next(
                (step * result["step_s"] for step, known in enumerate(shares) if known >= share), None
            )
            for share in (0.5, 0.9)
        }
        rows.append({"range_m": row["range_m"], "loss": row["loss"], **times_s, "known_at_end": shares[-1]})
    return {**result, "rows": rows}


def save(result: dict[str, Any], path: Path) -> None:
    """Draw the share of agents that know the command against time."""
    from benchmarks.plots import coverage, write

    write(coverage(result), path)


def _shares(range_m: float | None, loss: float, seed: int) -> list[float]:
    scenario = coverage_scenario(range_m, loss, seed)
    swarm = InProcess(scenario)
    shares = []
    for record, _ in swarm.steps():
        if record.time_s >= SENT_S:
            shares.append(sum(agent.commands.knows(0) for agent in swarm.agents) / len(swarm.agents))
    return shares
