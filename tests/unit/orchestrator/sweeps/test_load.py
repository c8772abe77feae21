"""Sweep files: what varies and how, and every mistake said in one clear line."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.sweeps.load import built_in, load_sweep, make_sweep, with_absolute_grids
from deltaswarm_orchestrator.sweeps.plan import MAX_RUNS, Sweep
from deltaswarm_wire import checked
from deltaswarm_wire.checked import SettingsError
from tests.support.complaints import names
from tests.support.sweeping import described, made, mistakes, written
from tests.support.tiers import in_one_test

AXIS = "[sweep.axes]\nagents.speed_mps = [1.0, 2.0]\n"

Printed = pytest.CaptureFixture[str]


def labels(sweep: dict[str, Any]) -> list[str]:
    return [variant.label for variant in made(sweep).variants]


def load(folder: Path, text: str, *overrides: str) -> Sweep:
    file = folder / "mine.toml"
    file.write_text(text)
    return load_sweep(str(file), overrides)


# What varies


def test_an_installed_package_adds_sweeps_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    """By an entry point: found by name, and listed under the point's name with its first line."""
    (tmp_path / "mine.toml").write_text('# Two speeds.\nschema = 1\nname = "mine"\nbase = "smoke"\n' + AXIS)
    (tmp_path / "added.py").write_text(
        f"from pathlib import Path\ndef files():\n    return {{'mine': Path('{tmp_path}/mine.toml')}}\n"
    )
    (tmp_path / "added-1.dist-info").mkdir()
    (tmp_path / "added-1.dist-info" / "METADATA").write_text("Name: added\nVersion: 1\n")
    (tmp_path / "added-1.dist-info" / "entry_points.txt").write_text("[deltaswarm.sweeps]\nours = added:files\n")
    monkeypatch.syspath_prepend(tmp_path)
    built_in.cache_clear()
    try:
        assert len(load_sweep("mine").variants) == 2
        assert main(["list", "--json"]) == 0
    finally:
        built_in.cache_clear()
    assert json.loads(capsys.readouterr().out)["ours"] == {"mine": "Two speeds."}


@pytest.mark.parametrize("axes", [{"control.delta": [2, 3]}, {"control": {"delta": [2, 3]}}], ids=["quoted", "nested"])
def test_a_dotted_key_is_the_same_quoted_or_not(axes: dict[str, Any]) -> None:
    """TOML reads the one as a key and the other as a table in a table."""
    sweep = made({"axes": axes})
    assert [variant.scenario.control.options["delta"] for variant in sweep.variants] == [2, 3]
    assert sweep.swept == ["control.delta"]
    assert labels({"axes": axes}) == ["delta=2", "delta=3"]


def test_axes_are_combined_in_the_files_order() -> None:
    sweep = made({"axes": {"control.delta": [2, 3], "radio.loss": [0.0, 0.5]}})
    assert [tuple(variant.keys.values()) for variant in sweep.variants] == [(2, 0.0), (2, 0.5), (3, 0.0), (3, 0.5)]
    assert sweep.variants[1].label == "delta=2, loss=0.5"


def test_paired_lists_vary_together() -> None:
    """Agents with their arena: as many variants as values, each labelled."""
    paired = {"label": ["few", "many"], "agents.count": [4, 9], "arena": {"width_m": [40.0, 60.0]}}
    sweep = made({"paired": [paired]})
    assert [(one.label, one.scenario.agents.count, one.scenario.arena.width_m) for one in sweep.variants] == [
        ("few", 4, 40.0),
        ("many", 9, 60.0),
    ]
    assert sweep.swept == ["agents.count", "arena.width_m"]


def test_axes_pairs_and_variants_are_all_combined() -> None:
    """Every value of each with every one of the others, labels joined in that order."""
    sweep = {
        "axes": {"radio.loss": [0.0, 0.5]},
        "paired": [{"label": ["a", "b"], "agents.count": [3, 4]}],
        "variants": [{"control.delta": 2}, {"label": "free", "control.mode": "decentralised"}],
    }
    assert len(labels(sweep)) == 8
    assert labels(sweep)[:3] == ["loss=0.0, a, delta=2", "loss=0.0, a, free", "loss=0.0, b, delta=2"]


def test_a_variant_keeps_what_it_does_not_change() -> None:
    """Its columns say the value it has, not only those it was given; one that changes nothing is the base."""
    sweep = made({"variants": [{"control.delta": 7}, {"radio": {"loss": 0.5}}, {}]})
    assert [dict(one.keys) for one in sweep.variants] == [
        {"control.delta": 7, "radio.loss": 0.0},
        {"control.delta": 3, "radio.loss": 0.5},
        {"control.delta": 3, "radio.loss": 0.0},
    ]
    assert [one.label for one in sweep.variants] == ["delta=7", "loss=0.5", "base"]


def test_whole_tables_and_lists_can_be_values() -> None:
    """A density as a whole; the variants do not share what they were made of."""
    uniform, grouped = {"kind": "uniform"}, {"mean_m": [10.0, 10.0], "covariance_m2": [[9.0, 0.0], [0.0, 9.0]]}
    sweep = made({"axes": {"events.density": [uniform, grouped]}})
    assert [one.scenario.events.density.kind for one in sweep.variants] == ["uniform", "gaussian"]
    means = made({"axes": {"events.density.mean_m": [[5.0, 5.0], [20, 20]]}})
    assert [one.keys["events.density.mean_m"] for one in means.variants] == [[5.0, 5.0], [20.0, 20.0]]


def test_what_all_share_comes_from_base_then_file_then_command_line(tmp_path: Path) -> None:
    """The later wins, and the sweep's own record keeps all of it: it makes the same sweep again."""
    text = 'schema = 1\nbase = "smoke"\n[scenario]\nradio.loss = 0.1\nradio.range_m = 9.0\n[sweep.axes]\n'
    sweep = load(tmp_path, text + "control.delta = [2]", "radio.loss=0.2")
    (variant,) = sweep.variants
    assert (variant.scenario.radio.loss, variant.scenario.radio.range_m) == (0.2, 9.0)
    assert variant.scenario.agents.count == 6
    assert sweep.file.scenario == {"radio.loss": 0.2, "radio.range_m": 9.0}
    assert sweep.name == "mine"


def test_files_are_looked_for_beside_the_file_that_names_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Base scenario and grids, wherever the command is called; on the command line, where it is called."""
    (tmp_path / "sub").mkdir()
    for number in (1, 2, 3):
        np.savetxt(tmp_path / ("sub" if number < 3 else ".") / f"{number}.csv", np.eye(3) * number, delimiter=",")
    (tmp_path / "sub" / "base.toml").write_text('schema = 1\nname = "b"\n[run]\nduration_s = 77.0\n')
    text = 'schema = 1\nbase = "base.toml"\n[scenario]\nevents.density.kind = "grid"\n'
    monkeypatch.chdir(tmp_path)
    sweep = load(tmp_path / "sub", text + '[sweep.axes]\nevents.density.file = ["1.csv", "2.csv"]\n')
    assert [Path(one.scenario.events.density.file) for one in sweep.variants] == [
        tmp_path / "sub" / "1.csv",
        tmp_path / "sub" / "2.csv",
    ]
    assert sweep.variants[0].scenario.run.duration_s == 77.0
    kept = with_absolute_grids(checked.plain(sweep.file), sweep.beside)
    assert kept["sweep"]["axes"]["events"]["density"]["file"] == [str(tmp_path / "sub" / f"{n}.csv") for n in (1, 2)]
    drawn = "[sweep.axes]\ncontrol.delta = [2]\n[sensitivity]\npoints = 10\n[[sensitivity.range]]\n"
    drawn += 'name = "events.density.file"\ntitle = "Grid"\nchoices = { one = "1.csv", two = "2.csv" }\n'
    sweep = load(tmp_path / "sub", text + drawn)
    assert {Path(one.scenario.events.density.file).name for one in sweep.variants} <= {"1.csv", "2.csv"}
    [drawn_from] = with_absolute_grids(checked.plain(sweep.file), sweep.beside)["sensitivity"]["range"]
    assert drawn_from["choices"] == {name: str(tmp_path / "sub" / f"{n}.csv") for name, n in (("one", 1), ("two", 2))}
    grids = '[sweep.axes]\n"events.density" = [{ kind = "grid", file = "1.csv" }]\n'
    whole = load(tmp_path / "sub", 'schema = 1\nbase = "base.toml"\n' + grids)
    assert Path(whole.variants[0].scenario.events.density.file) == tmp_path / "sub" / "1.csv"
    (variant,) = load(tmp_path / "sub", text + "[sweep.axes]\ncontrol.delta=[2]", "events.density.file=3.csv").variants
    assert Path(variant.scenario.events.density.file) == tmp_path / "3.csv"


@in_one_test("named", ["", 3, None, ["a.csv"]])
def test_what_names_no_grid_is_left_as_it_is(named: Any) -> None:
    """No file is no folder, and what is no name is a mistake like any other."""
    axes = {"axes": {"control.delta": [2]}}
    table = {"schema": 1, "base": "smoke", "sweep": axes, "scenario": {"events": {"density": {"file": named}}}}
    if named == "":
        assert make_sweep(table, Path("/somewhere")).variants[0].scenario.events.density.file == ""
    else:
        assert any("events.density.file" in one for one in mistakes(table))


# Mistakes

AXES: dict[str, Any] = {"axes": {"control.delta": [2, 3]}}
MANY = list(range(1, 1001))

WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": ({"axes": {"control.dleta": [2]}}, "control.dleta"),
    "unknown in one variant": ({"variants": [{"control.delta": 2}, {"control.delay": 3}]}, "control.delay"),
    "unknown setting": ({**AXES, "repeat": 3}, "sweep.repeat"),
    "empty list": ({"axes": {"control.delta": []}}, "sweep.axes.control.delta: []"),
    "no list": ({"axes": {"control": {"delta": 3}}}, "sweep.axes.control.delta: 3"),
    "table of tables": ({"axes": {"a": {"b": {"c": 1}}}}, "sweep.axes.a.b.c: 1"),
    "empty table": ({"axes": {"control": {}}}, "sweep.axes.control"),
    "lengths": ({"paired": [{"control.delta": [2, 3], "radio.loss": [0.1]}]}, "sweep.paired[0]"),
    "quoted and nested": ({"axes": {"control.delta": [2], "control": {"delta": [3]}}}, "sweep.axes.control.delta"),
    "twice in a variant": (
        {"variants": [{"control.delta": 2, "control": {"delta": 3}}]},
        "sweep.variants[0].control.delta",
    ),
    "axis and pair": ({**AXES, "paired": [{"control.delta": [4]}]}, "sweep.paired[0].control.delta"),
    "table and key in it": ({"axes": {"control": [{"delta": 3}], "control.delta": [2]}}, "sweep.axes.control.delta"),
    "nothing": ({"repeats": 3}, "sweep"),
    "seed": ({"axes": {"seed": [1, 2]}}, "sweep.axes.seed"),
    "record": ({"variants": [{"record": "off"}]}, "sweep.variants.record"),
    "name": ({"axes": {"name": ["a", "b"]}}, "sweep.axes.name"),
    "third variant": (
        {"variants": [{"control.delta": 2}, {"control.delta": 3}, {"control.delta": 0}]},
        "control.delta: 0",
    ),
    "kind of value": ({"axes": {"control.mode": [3]}}, "control.mode: 3"),
    "two keys at odds": ({"axes": {"radio.range_m": [5.0]}}, "control.d_min_m: 6"),
    "no table": ({"axes": {"control.delta.x": [1]}}, "control.delta: {'x': 1}"),
    "empty key": ({"axes": {"control..delta": [1]}}, "control..delta"),
    "repeats": ({**AXES, "repeats": 0}, "sweep.repeats: 0"),
    "repeats of nobody": ({**AXES, "repeats_of": {"delta=7": 30}}, "sweep.repeats_of.delta=7"),
    "too few repeats of one": ({**AXES, "repeats_of": {"delta=2": 19}}, "sweep.repeats_of.delta=2: 19"),
    "repeats of one no number": ({**AXES, "repeats_of": {"delta=2": 30.5}}, "sweep.repeats_of.delta=2: 30.5"),
    "too many repeats of one": ({**AXES, "repeats_of": {"delta=2": MAX_RUNS}}, "sweep.repeats_of"),
    "prove": ({**AXES, "prove": -1}, "sweep.prove: -1"),
    "windows": ({**AXES, "series_every_s": -1}, "sweep.series_every_s: -1"),
    "seed of the sweep": ({**AXES, "seed": 1.5}, "sweep.seed: 1.5"),
    "too many": ({**AXES, "repeats": MAX_RUNS}, f"sweep: 2 variants x {MAX_RUNS} repeats"),
    "far too many": (
        {"axes": dict.fromkeys(("control.delta", "control.rho", "control.gamma_max", "agents.count"), MANY)},
        "sweep: 1000000000000 variants x 20 repeats",
    ),
    "one label twice": (
        {"variants": [{"label": "a", "control.delta": 2}, {"label": "a", "control.delta": 3}]},
        "sweep: 2 variants called 'a'",
    ),
    "one value twice": ({"axes": {"control.delta": [2, 2]}}, "sweep: 2 variants called 'delta=2'"),
    "only labels": ({**AXES, "paired": [{"label": ["a", "b"]}]}, "sweep.paired[0]"),
    "no pairs": ({**AXES, "paired": [{}]}, "sweep.paired[0]"),
    "label as axis": ({"axes": {**AXES["axes"], "label": ["a"]}}, "sweep.axes.label"),
    "label no string": ({"variants": [{"label": 7, "control.delta": 2}]}, "sweep.variants[0].label: 7"),
    "label of two lines": ({"paired": [{"label": ["a\nb"], "control.delta": [2]}]}, "sweep.paired[0].label"),
    "axes no table": ({"axes": [1]}, "sweep.axes: [1]"),
    "paired no list": ({"paired": {"control.delta": [1]}}, "sweep.paired: {'control.delta': [1]}"),
    "variants no tables": ({"variants": [1, "a"]}, "sweep.variants[0]: 1"),
    "huge number": ({"axes": {"control.delta": [10**5000]}}, "control.delta: int"),
    "huge number, no list": ({"axes": {"control.delta": 10**5000}}, "sweep.axes.control.delta: int"),
    "beyond 64 bits": ({"axes": {"control.delta": [2**70]}}, f"control.delta: {2**70}"),
    "not a number": ({"axes": {"radio.loss": [float("nan")]}}, "radio.loss: nan"),
    "grid not there": (
        {"variants": [{"events.density.kind": "grid", "events.density.file": "/no/such.csv"}]},
        "events.density.file must be readable (No such file or directory) (got '/no/such.csv')",
    ),
}


@in_one_test(("sweep", "message"), WRONG.values())
def test_a_mistake_is_said_in_one_clear_line(sweep: dict[str, Any], message: str) -> None:
    """It names the key and what was found; nothing else is reported except what follows from it."""
    found = mistakes(described(sweep))
    assert any(names(line, message) for line in found), found
    assert len(found) <= 2
    assert all(len(line) < 400 for line in found)


def test_all_mistakes_are_told_at_once() -> None:
    """In the form of the sweep, and in what its runs share."""
    sweep = {"axes": {"control.delta": 3, "seed": [1]}}
    found = mistakes(described(sweep, scenario={"radio": {"los": 1.0}, "seed": 4}))
    assert len(found) == 4
    for said in ("radio.los: 'loss'", "seed: [scenario]"):
        assert any(names(line, said) for line in found), found


def test_a_wrong_key_of_the_sweep_hides_no_other_mistake() -> None:
    """Neither in its own tables nor in the scenarios; and what follows from it alone is not told besides."""
    axes = {"control.delat": [3], "radio.range_m": [9.0, -1.0]}
    table = described({"axes": axes, "repeats": 0, "reps": 3}, scenario={"radio": {"los": 1.0}}, nmae="x")
    said = (
        *("control.delat: 'delta'", "nmae: 'name'", "radio.los: 'loss'"),
        *("radio.range_m: -1.0", "sweep.repeats: 0", "sweep.reps: 'repeats'"),
    )
    found = sorted(mistakes(table))
    assert [names(line, one) for line, one in zip(found, said, strict=True)] == [True] * 6, found
    [line] = mistakes(described({"axis": axes}))
    assert names(line, "sweep.axis: 'axes'")
    assert len(mistakes(described({"axes": axes}, bsae="x", base="no-such"))) == 2


@in_one_test(
    ("other", "message"),
    [
        ({"schema": 2}, "schema: 2"),
        ({"base": "no-such"}, "base: 'no-such'; there is no file"),
        ({"base": "x" * 5000}, "base: 'xxx"),
        ({"base": "a\0b"}, "base: 'a\\x00b'; there is no file"),
        ({"base": 3}, "base: 3"),
        ({"name": "a/b"}, "name: 'a/b'"),
        ({"name": ".."}, "name: '..'"),
        ({"scenario": {"record": "views"}}, "record: [scenario]"),
        ({"scenario": {"control": {"delta": 2}}}, "control.delta: [scenario]"),
        ({"scenario": {"foo": {}}}, "scenario.foo"),
        ({"scenario": {"control.rho": 1, "control": {"rho": 2}}}, "scenario.control.rho"),
        ({"sweep": 4}, "sweep: 4"),
        ({"axes": {}}, "axes"),
    ],
)
def test_mistakes_beside_the_axes_are_said_too(other: dict[str, Any], message: str) -> None:
    """In the base scenario, in what all share, in the file's own keys."""
    (line,) = mistakes({**described(AXES), **other})
    assert names(line, message), line


@in_one_test(
    ("override", "message"),
    [
        ("control.delta=9", "control.delta: --set"),
        ("seed=3", "seed: --set"),
        ("novalue", "--set: 'novalue'"),
        ("radio.loss=2", "radio.loss: 2"),
    ],
)
def test_an_override_that_would_do_nothing_is_refused(override: str, message: str) -> None:
    with pytest.raises(SettingsError) as caught:
        make_sweep(described(AXES), overrides=["radio.range_m=9", override])
    [problem] = caught.value.problems
    assert names(str(problem), message), problem


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "schema"),
        ("schema = 1\n", "[sweep.axes]"),
        ("schema = \n", "(at line 1, column 10)"),
        ("schema = 1\n[sweep.axes]\ncontrol.dleta = [2]\n", "control.dleta"),
        ("schema = 1\n[sweep]\naxes.control.delta = " + "[" * 2000, "TOML"),
        ("schema = 1\n[sweep.axes]\n" + ".".join("a" * 3000) + " = [1]", "unknown key"),
        ("schema = 1\n[scenario]\n" + ".".join("a" * 3000) + " = 1\n[sweep.axes]\nradio.loss=[0.1]", "unknown key"),
        ("schema = 1\n[sweep.axes]\ncontrol.delta = [0x" + "f" * 6000 + "]", "control.delta"),
        ("schema = 1\n[sweep.axes]\ncontrol.delta = [1979-05-27]", "datetime.date(1979, 5, 27)"),
    ],
    ids=range(9),
)
def test_a_wrong_file_ends_the_command_with_2(tmp_path: Path, text: str, message: str, capsys: Printed) -> None:
    """Each mistake on standard error, each line under the command's name, nothing made."""
    file = tmp_path / "mine.toml"
    file.write_text(text)
    assert main(["sweep", str(file), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert message in printed.err
    assert all(line.startswith("deltaswarm: ") for line in printed.err.splitlines())
    assert not (tmp_path / "out").exists()


def test_a_file_that_is_no_text_ends_the_command_with_2(tmp_path: Path, capsys: Printed) -> None:
    """And so do a folder, a name that is too long, and none of that name."""
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for name in (str(tmp_path / "binary.toml"), str(tmp_path), "x" * 5000, "smoek", ""):
        assert main(["sweep", name]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_dry_run_lists_the_variants_and_does_nothing(
    tmp_path: Path, capsys: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", str(written(tmp_path)), "--dry-run", "--repeats", "4"]) == 0
    first, *variants = capsys.readouterr().out.splitlines()
    assert re.findall(r"\d+", first) == ["3", "4", "12"]
    assert variants == ["loss=0.0", "loss=0.2", "loss=0.4"]
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_settings_of_the_command_line_are_checked_as_the_files(tmp_path: Path, capsys: Printed) -> None:
    assert main(["sweep", str(written(tmp_path)), "--repeats", "0", "--seed", "-1", "--prove", "-1"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 3
