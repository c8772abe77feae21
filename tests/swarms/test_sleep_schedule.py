"""Agents that are left alone while they have nothing to decide: they decide as if asked in every step."""

from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from tests.support.airs import EVERYTHING
from tests.support.tiers import nightly

BUSY = ("agents.count=12", "events.rate_hz=0.06", "control.delta=2", "record=off")
STEPS = 400

FAULTS = (
    'fault=[{kind="freeze", at_s=50, duration_s=60, fraction=0.3},'
    '{kind="restart", at_s=120, duration_s=30, fraction=0.3},'
    '{kind="kill", at_s=160, agents=[3]},'
    '{kind="sensor-noisy", at_s=40, duration_s=200, noise_m=1.0, miss=0.3, agents=[4]},'
    '{kind="sensor-blind", at_s=90, duration_s=100, agents=[5]},'
    '{kind="actuator-slow", at_s=60, duration_s=150, factor=0.4, agents=[6, 7]},'
    '{kind="actuator-stuck", at_s=100, duration_s=120, agents=[8, 9]},'
    '{kind="radio-dead", at_s=100, duration_s=100, agents=[10]},'
    '{kind="lying", at_s=220, duration_s=60, phantoms=2, agents=[11]}]'
)
OBSTACLES = "arena.obstacles=[{corners_m=[[10, 10], [18, 11], [16, 20]]}, {corners_m=[[25, 22], [34, 24], [30, 33]]}]"


def decisions(sets: Sequence[str], steps: int, seed: int) -> Iterator[tuple[tuple[Any, ...], int]]:
    """What a swarm says, is and does in each step, and how many agents were asked."""
    swarm = InProcess(load_scenario("smoke", [*BUSY, *sets], seed))
    world = swarm.world
    for step in range(steps):
        record = swarm.step(step, step == steps - 1)
        observed = {agent: act.observed for agent, (_, act) in world.intake.acts.items() if act.observed}
        reports = [forwarded.report for forwarded in world.forwarded]
        state = (
            world.intake.transmitted,
            world.closed.tree_statuses,
            world.environment.positions_m.tolist(),
            observed,
            reports,
        )
        yield state, record.agents_asked


@pytest.mark.parametrize(
    "sets",
    [
        ["control.mode=hybrid", "control.recruitment_interval_s=20", "run.step_s=0.5"],
        ["control.mode=hybrid", *EVERYTHING],
        ["control.mode=adaptive", "run.step_s=0.5", FAULTS, "radio.loss=0.2", OBSTACLES],
        ["control.mode=hierarchical", "control.patience_finds=0.3", "control.root_succession=true", FAULTS],
        ["control.mode=hybrid", "control.recruitment_places=any", "control.idle_root=leaves"],
        *nightly(
            ["control.mode=decentralised"],
            ["control.mode=hierarchical"],
            ["control.mode=hybrid"],
            ["control.mode=hybrid", "radio.loss=0.3"],
            ["control.mode=hybrid", "radio.latency_s=2", "radio.jitter_s=3"],
            ["control.mode=adaptive"],
            ["control.delta_rule=bandit", "events.rate_hz=0.2"],
            ["control.delta_rule=learned", f"control.policy={[(-1) ** k * (k % 7) / 4 for k in range(24)]}"],
            ["control.mode=decentralised", "control.return_to_finds=true"],
            ["control.mode=decentralised", FAULTS],
            ["control.mode=hybrid", FAULTS],
            ["control.mode=hybrid", FAULTS, "radio.latency_s=1.5", OBSTACLES],
            ["control.mode=hierarchical", OBSTACLES],
        ),
    ],
    ids=lambda sets: " ".join(sets)[:60],
)
@pytest.mark.parametrize("seed", [1])
def test_every_decision_is_the_same_with_and_without_sleep(sets: list[str], seed: int) -> None:
    """Frames on the air, roles, places, what is observed, what is reported; and the sleep saves work."""
    asleep = awake = 0
    quiet, asked = decisions(sets, STEPS, seed), decisions([*sets, "run.ask_every_step=true"], STEPS, seed)
    for step, ((one, few), (other, many)) in enumerate(zip(quiet, asked, strict=True)):
        assert one == other, step
        asleep, awake = asleep + few, awake + many
    assert asleep < awake
