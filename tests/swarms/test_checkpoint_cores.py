"""World, agents and operator, put away in the middle of a run and taken out again: nothing is another than before."""

import pickle
from collections.abc import Sequence

import pytest

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.operator_messages import Clock
from tests.support.airs import EVERYTHING
from tests.swarms.test_sleep_schedule import BUSY, FAULTS

STEPS, EVERY = 300, 23
UPLINK = "uplink={loss=0.2, latency_s=3, bandwidth={sender_bytes_per_s=40}, base_m=[20, 20], range_m=15, relay=true}"


def digests(sets: Sequence[str], *, every: int) -> tuple[str, str, dict[str, object]]:
    """Of a run in which all is put away after so many steps, again and again."""
    scenario = load_scenario("smoke", [f"run.duration_s={STEPS}", *sets])
    swarm = InProcess(scenario)
    for step in range(STEPS):
        record = swarm.step(step, step == STEPS - 1)
        swarm.operator.close_step(Clock(step, record.time_s, step == STEPS - 1), 0)
        if (step + 1) % every == 0:
            swarm.world = pickle.loads(pickle.dumps(swarm.world))
            swarm.agents = [pickle.loads(pickle.dumps(agent)) for agent in swarm.agents]
            swarm.operator = pickle.loads(pickle.dumps(swarm.operator))
            swarm.operator.resume()
    return swarm.world.digest.hex(), swarm.operator.digest_hex, swarm.world.totals(True)


@pytest.mark.parametrize(
    "sets",
    [
        [*BUSY, "control.mode=decentralised"],
        [*BUSY, "control.mode=hierarchical", "events.density={kind='uniform'}"],
        [*BUSY, "control.mode=hybrid", "events.density={path_m=[[5, 5], [30, 10]], path_s=[50, 250]}"],
        [*BUSY, "control.mode=hybrid", FAULTS],
        [*BUSY, "control.mode=hybrid", *EVERYTHING],
        [*BUSY, "control.mode=hybrid", UPLINK],
        [*BUSY, "control.mode=hybrid", FAULTS, UPLINK, "run.step_s=0.5"],
        ["control.mode=potential"],
    ],
    ids=lambda sets: " ".join(sets)[:60],
)
def test_a_run_goes_on_as_if_nothing_had_been(sets: list[str]) -> None:
    assert digests(sets, every=EVERY) == digests(sets, every=STEPS + 1)
