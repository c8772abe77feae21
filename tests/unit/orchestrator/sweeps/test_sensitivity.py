"""Sensitivity sweeps: points drawn from ranges of scenario keys, the same for all variants."""

import math
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from deltaswarm_orchestrator.sweeps import load
from deltaswarm_orchestrator.sweeps.load import load_sweep, make_sweep
from deltaswarm_orchestrator.sweeps.plan import Sweep, replicate_seed
from deltaswarm_orchestrator.sweeps.sensitivity import RangeSettings, SensitivitySettings, corners, drawn
from deltaswarm_wire import checked
from deltaswarm_wire.checked import SettingsError
from tests.support.sweeping import described, mistakes

RATE = {"name": "events.rate_hz", "title": "Event rate", "unit": "1/s", "low": 0.05, "high": 0.5, "scale": "log"}
RANGE = {"name": "radio.range_m", "title": "Radio range", "unit": "m", "low": 7.0, "high": 15.0}
COUNT = {"name": "agents.count", "title": "Agents", "low": 4.0, "high": 9.0, "integer": True}
RECRUITS = {"name": "control.recruitment", "title": "Recruitment", "choices": {"on": True, "off": False}}
MODES = {"paired": [{"label": ["trees", "none"], "control.mode": ["hybrid", "decentralised"]}]}


def table(*ranges: dict[str, Any], points: int = 40, sweep: dict[str, Any] = MODES, **own: Any) -> dict[str, Any]:
    """A sensitivity sweep over short runs, with two control modes."""
    sensitivity = {"points": points, "range": list(ranges or (RATE, RANGE, COUNT, RECRUITS)), **own}
    return described(sweep, sensitivity=sensitivity)


def made(*ranges: dict[str, Any], **own: Any) -> Sweep:
    return make_sweep(table(*ranges, **own))


def test_a_share_of_a_range_is_a_value_of_its_distribution() -> None:
    """Uniform, or uniform in the logarithm; whole numbers and choices equally often, ends included."""
    assert [RangeSettings(low=2.0, high=6.0).at(share) for share in (0.0, 0.25, 1.0)] == [2.0, 3.0, 6.0]
    log = RangeSettings(low=0.01, high=1.0, scale="log")
    assert [log.at(share) for share in (0.0, 0.5, 1.0)] == pytest.approx([0.01, 0.1, 1.0])
    whole = RangeSettings(low=3.0, high=5.0, integer=True)
    assert Counter(whole.at((i + 0.5) / 300) for i in range(300)) == {3: 100, 4: 100, 5: 100}
    assert type(whole.at(0.0)) is int
    assert [RangeSettings(low=1.0, high=4.0, integer=True, scale="log").at(share) for share in (0, 1)] == [1, 4]
    places = RangeSettings(choices={"any": "any", "events": "with-events", "x": [1]})
    names = [places.at(share) for share in (0.0, 0.33, 0.34, 0.66, 0.67, 1.0)]
    assert names == ["any", "any", "events", "events", "x", "x"]
    assert [places.value(name) for name in names[::2]] == ["any", "with-events", [1]]


def test_a_latin_hypercube_has_a_point_in_each_stratum_of_each_range() -> None:
    """40 points: one in each fortieth of either range; the same seed gives the same points."""
    ranges = (RangeSettings("a", "A", low=0.0, high=40.0), RangeSettings("b", "B", low=1.0, high=2.0**40, scale="log"))
    points = drawn(SensitivitySettings(points=40, seed=7, range=ranges))
    assert sorted(math.floor(point["a"]) for point in points) == list(range(40))
    assert sorted(math.floor(math.log2(point["b"])) for point in points) == list(range(40))
    assert points == drawn(SensitivitySettings(points=40, seed=7, range=ranges))
    assert points != drawn(SensitivitySettings(points=40, seed=8, range=ranges))


def test_sobol_points_fill_each_cell_of_a_plane_equally() -> None:
    """64 scrambled points of two ranges: four in each of the 16 cells, and so in the first 16 points, one in each."""
    ranges = (RangeSettings("a", "A", low=0.0, high=4.0), RangeSettings("b", "B", low=0.0, high=4.0))
    points = drawn(SensitivitySettings("sobol", 64, seed=3, range=ranges))
    cells = [(math.floor(point["a"]), math.floor(point["b"])) for point in points]
    assert set(Counter(cells).values()) == {4}
    assert set(Counter(cells[:16]).values()) == {1}


def test_all_variants_have_the_values_and_the_arrivals_of_a_point() -> None:
    """A point is a replicate: one seed, one value of each key, in all variants; other points have others."""
    sweep = made()
    jobs = sweep.jobs()
    assert sweep.size == "mine: 2 variants x 40 points, 80 runs"
    assert sweep.swept == ["control.mode", "events.rate_hz", "radio.range_m", "agents.count", "control.recruitment"]
    assert [job.variant.label for job in jobs] == ["trees", "none"] * 40
    for number, (trees, none) in enumerate(zip(jobs[::2], jobs[1::2], strict=True)):
        assert trees.replicate == none.replicate == number
        assert trees.scenario.seed == none.scenario.seed == replicate_seed(1, number)
        assert trees.scenario.events == none.scenario.events
        assert trees.scenario.radio == none.scenario.radio
        assert trees.scenario.agents == none.scenario.agents
        assert trees.variant.keys["events.rate_hz"] == trees.scenario.events.rate_hz
        assert (trees.variant.keys["control.recruitment"] == "on") is trees.scenario.control.options["recruitment"]
        assert 4 <= trees.scenario.agents.count <= 9
    assert len({job.scenario.events.rate_hz for job in jobs}) == 40


def test_fewer_points_are_the_first_ones() -> None:
    """So that a look at some points is a part of the whole, which takes over its runs."""
    few, all_points = made(sweep={**MODES, "repeats": 5}), made()
    assert [job.key for job in few.jobs()] == [job.key for job in all_points.jobs()[:10]]
    assert few.file.sensitivity == all_points.file.sensitivity


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"points": 39}, ["sensitivity.points must be at least 40, 10 for each of 4 ranges (got 39)"]),
        ({"method": "sobol", "points": 48}, ["must be a power of two for a Sobol sequence, such as 64 (got 48)"]),
        ({"method": "sobol", "points": 100}, ["such as 64 or 128 (got 100)"]),
        ({"method": "grid"}, ["sensitivity.method must be one of latin-hypercube, sobol"]),
        ({"pints": 3}, ["sensitivity.pints: unknown key; did you mean 'points'?"]),
        ({"range": []}, ["sensitivity.range: none"]),
        (
            {"range": [RATE, RATE], "points": 40},
            ["different keys (got 2 of 'events.rate_hz')", "different titles (got 2 of 'Event rate')"],
        ),
    ],
)  # fmt: skip
def test_a_drawing_that_cannot_be_is_refused(own: dict[str, Any], words: list[str]) -> None:
    """With the key, what must hold and what was given."""
    found = mistakes(table() | {"sensitivity": table()["sensitivity"] | own})
    assert len(found) == len(words)
    assert all(word in line for word, line in zip(words, found, strict=True)), found


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({**RANGE, "low": -1.0}, "sensitivity.range[0] (radio.range_m) must be a number above 0"),
        ({**RANGE, "name": "radio.rangem"}, "sensitivity.range[0] (radio.rangem): unknown key; did you mean 'range_m'"),
        ({**RANGE, "high": 7.0}, "sensitivity.range[0].high must be above low, 7 (got 7)"),
        ({**RANGE, "high": None}, "sensitivity.range[0].high: missing"),
        ({**RANGE, "title": " "}, "sensitivity.range[0].title: missing"),
        ({**RANGE, "title": "radio.range_m"}, "sensitivity.range[0].title must be words for people, not the key"),
        ({**RANGE, "low": 0.0, "scale": "log"}, "must be above 0 on a logarithmic scale"),
        ({**RANGE, "integer": True, "low": 7.5}, "must be whole numbers"),
        ({**COUNT, "integer": False}, "sensitivity.range[0] (agents.count) must be an integer"),
        ({**COUNT, "low": 0.0}, "sensitivity.range[0] (agents.count) must be an integer from 1"),
        ({**RECRUITS, "choices": {"on": True, "off": 0.5}}, "(control.recruitment) must be true or false (got 0.5)"),
        ({**RECRUITS, "choices": {"on": True}}, "must be at least two different values"),
        ({**RECRUITS, "choices": {"on": True, "also on": True}}, "must be at least two different values"),
        ({**RECRUITS, "low": 1.0}, "sensitivity.range[0].low must not be given with choices"),
        ({**RANGE, "name": "seed"}, "sensitivity.range[0].seed: cannot vary"),
        ({**RANGE, "name": "control.mode"}, "sensitivity.range[0].control.mode: also given elsewhere"),
        ({**RANGE, "name": "control"}, "sweep.paired[0].control.mode: control varies too"),
    ],
)  # fmt: skip
def test_a_range_that_cannot_be_drawn_is_refused(wrong: dict[str, Any], words: str) -> None:
    given = {name: value for name, value in wrong.items() if value is not None}
    assert any(words in line for line in mistakes(table(given))), mistakes(table(given))


def test_the_first_point_that_is_not_legal_is_named_with_its_values() -> None:
    """Each range is legal by itself, but a corner of the box is not: members would not hear each other."""
    near = {"name": "control.d_min_m", "title": "Distance of members", "unit": "m", "low": 4.0, "high": 7.5}
    [line] = mistakes(table(RATE, near, RANGE))
    assert line.startswith("control.d_min_m, at a corner of [sensitivity] (events.rate_hz = ")
    assert "control.d_min_m = 7.5, radio.range_m = 7" in line
    assert "must be below the radio's range, 7 m (got 7.5)" in line
    assert made(RATE, {**near, "high": 6.9}, RANGE).points


def test_a_point_within_legal_corners_is_checked_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """All points are checked, also those that a part of the sweep leaves out; the first wrong one is named."""
    points = drawn(SensitivitySettings(points=40, range=(RangeSettings(**RANGE), RangeSettings(**COUNT))))
    points[7] = {**points[7], "radio.range_m": 3.25}
    points[9] = {**points[9], "radio.range_m": 2.0}
    monkeypatch.setattr(load, "drawn", lambda settings: points)
    [line] = mistakes(table(RANGE, COUNT, sweep={**MODES, "repeats": 5}))
    assert f"at point 7 of [sensitivity] (radio.range_m = 3.25, agents.count = {points[7]['agents.count']})" in line


def test_corners_are_those_of_each_pair_of_ranges() -> None:
    """Of three ranges: three pairs with four corners each, the third range as in the point."""
    ranges = (
        RangeSettings("a", low=0.0, high=1.0),
        RangeSettings("b", low=2.0, high=3.0),
        RangeSettings("c", choices={"x": 7, "y": 8, "z": 9}),
    )
    found = list(corners(SensitivitySettings(range=ranges), {"a": 0.5, "b": 2.5, "c": "x"}))
    assert len(found) == 4 + 6 + 6
    assert {"a": 0.0, "b": 3.0, "c": "x"} in found
    assert {"a": 0.5, "b": 2.0, "c": "z"} in found
    one = SensitivitySettings(range=ranges[:1])
    assert list(corners(one, {"a": 0.5})) == [{"a": 0.0}, {"a": 1.0}]


def test_a_choice_may_be_of_any_form(tmp_path: Path) -> None:
    """A list, a word, and a file beside the sweep's: told by its name, which stays with the point."""
    (tmp_path / "town.csv").write_text("1,2\n3,4\n")
    spread = {"name": "events.density.covariance_m2", "title": "Spread"}
    narrow, wide = [[50, 0], [0, 50]], [[200, 0], [0, 200]]
    sweep = made({**spread, "choices": {"narrow": narrow, "wide": wide}})
    for job in sweep.jobs():
        is_wide = job.scenario.events.density.covariance_m2[0][0] == 200.0
        assert job.variant.keys["events.density.covariance_m2"] == ("wide" if is_wide else "narrow")
    kinds = {"name": "events.density.kind", "title": "Kind", "choices": {"a": "gaussian", "b": "uniform"}}
    assert {scenario.events.density.kind for scenario in made(kinds).scenarios} == {"gaussian", "uniform"}
    files = {"name": "events.density.file", "title": "Town", "choices": {"old": "town.csv", "new": "./town.csv"}}
    shared = {"run.duration_s": 60.0, "metrics.horizon_s": 20.0, "events.density.kind": "grid"}
    found = make_sweep(table(files) | {"scenario": shared}, tmp_path).scenarios
    assert {Path(scenario.events.density.file).resolve() for scenario in found} == {tmp_path / "town.csv"}


def test_other_mistakes_are_reported_once_and_as_ever() -> None:
    """A mistake in what all points share is not one of a point."""
    [line] = mistakes(table() | {"scenario": {"radio.losss": 1}})
    assert line.startswith("radio.losss: unknown key")
    [line] = mistakes(table(sweep={**MODES, "repeats": 41}))
    assert line == "sweep.repeats must be at most sensitivity.points, 40 (got 41)"
    [line] = mistakes(table(sweep={}))
    assert line.endswith("(got nothing varies)")
    with pytest.raises(SettingsError, match=r"radio.range_m varies in this sweep, so it cannot also be given by --set"):
        make_sweep(table(), Path(), ["radio.range_m=9.0"])


def test_runs_of_a_point_are_counted_from_point_to_point() -> None:
    """Each with a seed of its own; of fewer points the same runs, so that a look at some is a part of all."""
    several = {**table(RANGE, COUNT), "sensitivity": {**table(RANGE, COUNT)["sensitivity"], "runs_per_point": 3}}
    jobs = make_sweep(several, Path()).jobs()
    values = {job.replicate: job.variant.keys["radio.range_m"] for job in jobs}
    assert len(values) == 120
    assert len({job.scenario.seed for job in jobs}) == 120
    once = {job.replicate: job.variant.keys["radio.range_m"] for job in made(RANGE, COUNT).jobs()}
    assert [values[number] for number in range(120)] == [once[number // 3] for number in range(120)]
    few = make_sweep({**several, "sweep": {**several["sweep"], "repeats": 5}}, Path()).jobs()
    assert len(few) == 15 * len(jobs) // 120
    assert {job.key for job in few} < {job.key for job in jobs}
    several["sensitivity"]["runs_per_point"] = 1000
    several["sensitivity"]["points"] = 101
    with pytest.raises(SettingsError, match=r"runs_per_point must be at most 100000 runs"):
        make_sweep(several, Path())


def test_windows_must_fit_the_steps_of_all_points() -> None:
    """Steps of 0.5, 1 and 3 s: a window of 20 s is not a whole number of the last."""
    steps = {"name": "run.step_s", "title": "Step", "choices": {"0.5 s": 0.5, "1 s": 1.0, "3 s": 3.0}}
    series = {**MODES, "series_every_s": 20.0}
    assert any("must be a whole number of steps of 3 s" in line for line in mistakes(table(RATE, steps, sweep=series)))
    steps["choices"] = {"0.5 s": 0.5, "1 s": 1.0, "2 s": 2.0}
    assert {scenario.run.step_s for scenario in made(RATE, steps, sweep=series).scenarios} == {0.5, 1.0, 2.0}


def test_the_sweeps_own_file_makes_the_same_points(tmp_path: Path) -> None:
    """The file that a sweep writes into its folder, from which it can be continued."""
    sweep = made(sweep={**MODES, "repeats": 5})
    (tmp_path / "sweep.toml").write_text(tomli_w.dumps(checked.plain(sweep.file)))
    again = load_sweep(str(tmp_path / "sweep.toml"))
    assert [job.key for job in again.jobs()] == [job.key for job in sweep.jobs()]
    assert len(load_sweep(str(tmp_path / "sweep.toml"), settings={"repeats": 40}).jobs()) == 80
