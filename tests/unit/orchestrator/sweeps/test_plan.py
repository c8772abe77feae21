"""What a sweep does: which runs, with which seeds, and by which content they are known."""

import dataclasses
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.sweeps.plan import SEED_BITS, Job, Variant, replicate_seed
from deltaswarm_scenario.density import DENSITIES, ComponentSettings
from deltaswarm_scenario.fault import FaultSettings
from deltaswarm_scenario.scenario import CLOCKS, RECORDS, Scenario
from tests.support.sweeping import made
from tests.support.weather import put_weather

SEEDS = st.integers(0, 2**63 - 1)


def job(scenario: Scenario, series_every_s: float = 60.0, label: str = "a", replicate: int = 0) -> Job:
    return Job(Variant(label, {}, scenario), replicate, scenario, series_every_s)


# Replicates and their seeds


def test_every_variant_has_every_replicate() -> None:
    """The first replicate of every variant comes first, so that what was interrupted can be compared."""
    jobs = made({"axes": {"control.delta": [2, 3]}, "repeats": 3}).jobs()
    assert [(one.variant.label, one.replicate) for one in jobs] == [
        (label, replicate) for replicate in range(3) for label in ("delta=2", "delta=3")
    ]


def test_a_replicates_seed_is_the_same_in_every_variant() -> None:
    """And another one in every replicate; it is in the scenario that is run."""
    jobs = made({"axes": {"control.delta": [2, 3, 4]}, "repeats": 5}).jobs()
    seeds = {one.replicate: {other.scenario.seed for other in jobs if other.replicate == one.replicate} for one in jobs}
    assert all(len(found) == 1 for found in seeds.values())
    assert len(set.union(*seeds.values())) == 5


@given(SEEDS, SEEDS, st.integers(0, 1000))
def test_seeds_derive_from_the_sweeps(seed: int, other: int, replicate: int) -> None:
    """By it and the replicate's number alone; a spreadsheet keeps them exactly."""
    found = replicate_seed(seed, replicate)
    assert found == replicate_seed(seed, replicate)
    assert found != replicate_seed(seed, replicate + 1)
    assert (found == replicate_seed(other, replicate)) == (seed == other)
    assert int(float(found)) == found < 2**SEED_BITS


def test_seeds_are_what_they_were() -> None:
    """Results in papers name them: they may not change with a version of ours or of numpy."""
    assert [replicate_seed(1, replicate) for replicate in range(3)] == [
        3630251794869490,
        37989810494438,
        7582958440146348,
    ]


def test_more_replicates_keep_the_first_ones() -> None:
    few, many = (made({"axes": {"control.delta": [2]}, "repeats": repeats}).jobs() for repeats in (2, 4))
    assert [one.key for one in many[:2]] == [one.key for one in few]


def test_a_variant_can_have_more_replicates_than_the_others() -> None:
    """Those that both have share their seeds, and the number of runs is told before they are done."""
    sweep = made({"axes": {"control.delta": [2, 3]}, "repeats": 2, "repeats_of": {"delta=3": 4}})
    numbers = [(one.variant.label, one.replicate) for one in sweep.jobs()]
    assert numbers == [("delta=2", 0), ("delta=3", 0), ("delta=2", 1), ("delta=3", 1), ("delta=3", 2), ("delta=3", 3)]
    seeds = [one.scenario.seed for one in sweep.jobs()]
    assert seeds == [replicate_seed(1, number) for _, number in numbers]
    assert "2 to 4 replicates, 6 runs" in sweep.size


def test_no_run_of_a_sweep_is_recorded() -> None:
    assert all(one.scenario.record == "off" for one in made({"axes": {"control.delta": [2]}}).jobs())


# What real processes do too


def test_the_sample_of_proofs_is_the_same_each_time() -> None:
    """As many as asked for, of the sweep's own runs; more replicates do not empty it."""
    axes = {"control.delta": [2, 3, 4], "radio.loss": [0.0, 0.5]}
    sweeps = [made({"axes": axes, "repeats": 4, "prove": prove}) for prove in (0, 3, 3, 1000)]
    samples = [[one.key for one in sweep.sample(sweep.jobs())] for sweep in sweeps]
    assert [len(sample) for sample in samples] == [0, 3, 3, 24]
    assert samples[1] == samples[2] == samples[3][:3]
    assert set(samples[3]) == {one.key for one in sweeps[0].jobs()}


def test_the_sample_of_proofs_is_spread() -> None:
    """Half of all runs are of every variant and of nearly every replicate, and not the first half of either."""
    axes = {"control.delta": [2, 3, 4], "radio.loss": [0.0, 0.5]}
    sweep = made({"axes": axes, "repeats": 20, "prove": 60})
    sample = sweep.sample(sweep.jobs())
    assert {one.variant.label for one in sample} == {variant.label for variant in sweep.variants}
    assert len({one.replicate for one in sample}) > 15


def test_runs_that_processes_cannot_do_are_not_in_the_sample() -> None:
    """Bounds exist in one process alone; a sweep of nothing else has no proofs."""
    mixed, bounds = (
        made({"axes": {"run.bound": kinds}, "repeats": 2, "prove": 10})
        for kinds in (["none", "everything"], ["everything"])
    )
    assert [one.scenario.run.bound for one in mixed.sample(mixed.jobs())] == ["none", "none"]
    assert bounds.sample(bounds.jobs()) == []


# By what a finished run is found again


def test_the_same_content_has_the_same_key() -> None:
    """Whatever the run, its variant and its replicate are called."""
    scenario = Scenario()
    same = job(replace(scenario, name="other"), label="b", replicate=7)
    assert job(scenario).key == same.key
    assert job(scenario).key == job(Scenario()).key


def test_another_window_of_the_series_has_another_key() -> None:
    assert job(Scenario(), 60.0).key != job(Scenario(), 30.0).key


def leaves(settings: Any, prefix: str = "") -> Iterator[str]:
    for spec in dataclasses.fields(settings):
        value = getattr(settings, spec.name)
        if dataclasses.is_dataclass(value):
            yield from leaves(value, f"{prefix}{spec.name}.")
        else:
            yield f"{prefix}{spec.name}"


CHOICES = (DENSITIES, CLOCKS, RECORDS)
PLUGGED = {"dynamics": "physics", "policy": "grouped"}
"""Another value of keys that name a plug-in."""


def changed(settings: Any, dotted: str) -> Any:
    """The settings with another value for one key; never mind whether it makes sense."""
    name, _, rest = dotted.partition(".")
    value = getattr(settings, name)
    if rest:
        return replace(settings, **{name: changed(value, rest)})
    other: Any
    if name == "mode":
        other = "decentralised"
    elif name in PLUGGED:
        other = PLUGGED[name]
    elif isinstance(value, bool):
        other = not value
    elif isinstance(value, int | float):
        other = value + 1
    elif isinstance(value, str):
        other = next((one for group in CHOICES if value in group for one in group if one != value), value + "x")
    elif name == "models":
        other = {"weather:Fog": {}}
    elif name == "fault":
        other = (FaultSettings("freeze", 0.0, 5.0, (1,)),)
    elif isinstance(value, dict):
        other = {**value, "delta": 4}
    elif value is None:
        other = (1.0, 2.0) if name == "base_m" else 1.0
    else:
        other = (ComponentSettings(),) if value == () else value[::-1] + value[:1]
    return replace(settings, **{name: other})


def test_any_other_scenario_has_another_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put_weather(tmp_path, monkeypatch)
    file = tmp_path / "grid.csv"
    np.savetxt(file, np.eye(3), delimiter=",")
    usual = job(Scenario()).key
    keys = [dotted for dotted in leaves(Scenario()) if dotted != "name"]
    assert len(keys) > 100
    for dotted in keys:
        other = changed(Scenario(), dotted)
        if other.events.density.kind == "grid":
            other = replace(other, events=replace(other.events, density=replace(other.events.density, file=str(file))))
        assert job(other).key != usual, dotted


def test_a_grid_is_known_by_its_weights(tmp_path: Path) -> None:
    """Not by its path: what is in the file may change, and its folder may be moved."""
    keys = []
    for name, grid in (("a.csv", np.eye(3)), ("a.csv", np.ones((3, 3))), ("b.csv", np.eye(3))):
        file = tmp_path / name
        np.savetxt(file, grid, delimiter=",")
        density = replace(Scenario().events.density, kind="grid", file=str(file))
        keys.append(job(replace(Scenario(), events=replace(Scenario().events, density=density))).key)
    assert keys[0] == keys[2] != keys[1]
    assert job(Scenario()).key not in keys
