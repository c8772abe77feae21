"""The built-in sweeps of limited networks: each limits what its name says, and nothing else."""

from typing import Any

import pytest

from deltaswarm_orchestrator.limits.experiments import EXPERIMENTS, MODES, Experiment
from deltaswarm_orchestrator.run.scenario import load_scenario
from deltaswarm_orchestrator.sweeps.load import BUILT_IN, load_sweep
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_wire import checked
from deltaswarm_wire.settings import Scenario

NAMES = tuple(EXPERIMENTS)


def scenario_of(sweep: Sweep, level: str, mode: str = "hybrid 3") -> Scenario:
    return next(one.scenario for one in sweep.variants if one.label == f"{level}, {mode}")


def differing(scenario: Scenario) -> dict[str, Any]:
    """The keys in which a scenario is not the paper's, each with its value."""
    base = checked.plain(load_scenario("paper-25", ["record=off"]))
    return dict(_differences(checked.plain(scenario), base))


def _differences(table: dict[str, Any], base: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    found = []
    for name, value in table.items():
        if isinstance(value, dict):
            found += _differences(value, base[name], f"{prefix}{name}.")
        elif value != base[name]:
            found.append((f"{prefix}{name}", value))
    return found


@pytest.mark.parametrize("experiment", EXPERIMENTS.values(), ids=NAMES)
def test_a_sweep_has_the_levels_of_its_experiment(experiment: Experiment) -> None:
    """All of them, for three modes, in the same order; with windows that fit those of the figures."""
    sweep = load_sweep(experiment.name)
    assert sweep.name == experiment.name in BUILT_IN
    labels = [variant.label for variant in sweep.variants]
    assert sorted(labels) == sorted(f"{level.label}, {mode}" for level in experiment.levels for mode in MODES)
    assert 300 % sweep.file.sweep.series_every_s == 0
    assert experiment.harder


@pytest.mark.parametrize("experiment", EXPERIMENTS.values(), ids=NAMES)
def test_without_its_limit_it_is_the_papers_swarm(experiment: Experiment) -> None:
    """In every experiment the same runs, so that they are done once; modes differ in nothing but the mode."""
    sweep = load_sweep(experiment.name)
    assert differing(scenario_of(sweep, experiment.base.label)) == {}
    assert differing(scenario_of(sweep, experiment.base.label, "decentralised")) == {"control.mode": "decentralised"}
    first, own = load_sweep("network-loss").jobs(), {job.key for job in sweep.jobs()}
    shared = {job.key for job in first if job.variant.label.startswith("loss=0.0") and job.replicate < 10}
    assert len(shared) == 30
    assert shared <= own


HARDEST = {
    "network-loss": {"radio.loss": 0.9},
    "network-range": {"radio.range_m": 6.5},
    "network-latency": {"radio.latency_s": 5.0, "radio.jitter_s": 2.5},
    "network-bandwidth": {"radio.bandwidth.sender_bytes_per_s": 20.0},
}


@pytest.mark.parametrize("name", HARDEST)
def test_the_hardest_level_is_what_its_name_says(name: str) -> None:
    """And differs in nothing else."""
    assert differing(scenario_of(load_sweep(name), EXPERIMENTS[name].hardest.label)) == HARDEST[name]


def test_loss_has_the_levels_and_seeds_of_its_bar() -> None:
    """10, 30 and 50 %, over 20 seeds."""
    sweep = load_sweep("network-loss")
    assert {0.1, 0.3, 0.5} <= {level.value for level in EXPERIMENTS["network-loss"].levels}
    assert sweep.file.sweep.repeats == 20
    for level in EXPERIMENTS["network-loss"].levels:
        assert scenario_of(sweep, level.label).radio.loss == level.value


def test_a_jammer_is_over_the_densest_place() -> None:
    """For as long as the experiment says, with the radius that its level says."""
    experiment = EXPERIMENTS["jamming"]
    sweep = load_sweep("jamming")
    for level in experiment.harder:
        scenario = scenario_of(sweep, level.label)
        (jammer,) = scenario.radio.jammers
        assert experiment.fault is not None
        assert jammer.center_m == scenario.events.density.mean_m
        assert (jammer.radius_m, jammer.from_s, jammer.until_s) == (
            level.value,
            experiment.fault.from_s,
            experiment.fault.until_s,
        )


def test_a_partition_halves_the_arena() -> None:
    """By a wall from edge to edge."""
    (wall,) = scenario_of(load_sweep("partition"), "halves").radio.walls
    assert (wall.a_m, wall.b_m, wall.from_s, wall.until_s) == ((50.0, 0.0), (50.0, 100.0), 3000.0, 6000.0)


def test_what_is_lost_is_lost_at_half_time() -> None:
    """A third of the agents, or the roots; beside it a swarm that had 17 from the beginning."""
    (third,) = scenario_of(load_sweep("lose-a-third"), "a third lost").fault
    assert (third.kind, third.at_s, third.fraction, third.roots) == ("kill", 4500.0, 0.33, False)
    assert differing(scenario_of(load_sweep("lose-a-third"), "17 from the beginning")) == {"agents.count": 17}
    (roots,) = scenario_of(load_sweep("lose-the-roots"), "roots lost").fault
    assert (roots.kind, roots.at_s, roots.fraction, roots.roots) == ("kill", 4500.0, None, True)
    for name in ("lose-a-third", "lose-the-roots"):
        fault = EXPERIMENTS[name].fault
        assert fault is not None
        assert (fault.from_s, fault.until_s, fault.over_s) == (4500.0, None, 4500.0)


def test_the_uplink_is_out_and_the_radio_is_not() -> None:
    """For as long as the experiment says."""
    scenario = scenario_of(load_sweep("uplink-outage"), "outage")
    (outage,) = scenario.uplink.outages
    assert (outage.from_s, outage.until_s) == (3000.0, 6000.0)
    assert set(differing(scenario)) == {"uplink.outages"}
