"""Tests of `import deltaswarm`: runs, their tables, and the keys and errors of everything that it does."""

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import pandas as pd
import pytest

import deltaswarm
from deltaswarm.keys import overrides
from deltaswarm_agent.controllers.potential import PotentialController
from deltaswarm_cli.main import main
from deltaswarm_wire.operator_messages import Report

SHORT = {"run.duration_s": 60.0, "run.step_s": 2.0}


@pytest.fixture(scope="module")
def run() -> deltaswarm.Run:
    return deltaswarm.run("smoke", SHORT, seed=3, progress=False)


def test_the_command_line_and_python_do_the_same_run(run: deltaswarm.Run, tmp_path: Path) -> None:
    """Equal digests; what the command line left can be opened, and has the same tables."""
    sets = [word for key, value in SHORT.items() for word in ("--set", f"{key}={value}")]
    assert main(["run", "smoke", *sets, "--seed", "3", "--in-process", "-q", "--out", str(tmp_path / "run")]) == 0
    opened = deltaswarm.open(tmp_path / "run")
    assert opened.digest == run.digest
    for name in ("series", "events", "reports", "poses"):
        pd.testing.assert_frame_equal(getattr(opened, name), getattr(run, name))
    assert opened.is_valid
    assert "smoke, hybrid, seed 3, 30 steps, valid" in repr(opened)


def test_a_run_that_is_not_over_is_opened_by_its_name(run: deltaswarm.Run, tmp_path: Path) -> None:
    """Where it is until then, what was interrupted, too."""
    shutil.copytree(run.folder, tmp_path / "run.part")
    assert deltaswarm.open(tmp_path / "run").folder == tmp_path / "run.part"


def test_tables_have_what_the_docstrings_say(run: deltaswarm.Run) -> None:
    """A row per step, event, report, and view and agent; times in seconds, whatever the length of a step."""
    assert list(run.series["time_s"]) == [2.0 * step for step in range(30)]
    assert len(run.events) == run.summary["arrivals"]["n"]
    assert len(run.reports) == run.series["reports_arrived"].sum()
    assert set(run.reports) == {"arrived_step", "arrived_s", *Report._fields} - {"answers"}
    assert set(run.reports["agent"]) <= set(range(6))
    first_told = run.reports.explode("events").groupby("events")["arrived_s"].min()
    told = run.events.set_index("event")["told_s"].dropna()
    pd.testing.assert_series_equal(
        first_told.sort_index(), told.sort_index(), check_names=False, check_index_type=False
    )
    last = run.poses[run.poses["time_s"] == run.poses["time_s"].max()]
    assert list(last["agent"]) == list(range(6))
    assert last["x_m"].between(0, 40).all()
    assert run.scenario["run"]["step_s"] == 2.0
    assert run.manifest["engine"] == "in-process"


def test_it_is_drawn_and_recorded(run: deltaswarm.Run, tmp_path: Path) -> None:
    """A figure of any moment that a notebook can show, and the recording as a file, which is not replaced unasked."""
    assert run.show()._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    assert run.show(time_s=20).axes[0].get_title() == "20 s"
    file = run.record(tmp_path / "a.mcap")
    assert file.read_bytes().startswith(b"\x89MCAP")
    with pytest.raises(deltaswarm.Error, match="exists"):
        run.record(file)
    with pytest.raises(deltaswarm.Error, match="time_s must be"):
        run.show(time_s=-1)


@pytest.mark.parametrize(
    ("scenario", "keys"),
    [
        (["smoek"], {}),
        (["smoke"], {"radio.loss": 2.0, "control.delt": 3}),
        (["smoke"], {"control.mode": "nowhere:Class"}),
        (["smoke"], {"agents.count": "many"}),
    ],
)
def test_a_mistake_is_one_exception_with_the_command_lines_text(
    scenario: list[str], keys: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    """Each mistake is a line, and each line is what `deltaswarm run` prints."""
    sets = [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]
    assert main(["run", *scenario, *sets, "--in-process"]) == 2
    printed = [line.removeprefix("deltaswarm: ") for line in capsys.readouterr().err.splitlines()]
    with pytest.raises(deltaswarm.Error) as raised:
        deltaswarm.run(*scenario, keys)
    assert str(raised.value).splitlines() == printed
    assert raised.value.code == 2


def test_other_mistakes_are_errors_too(tmp_path: Path, run: deltaswarm.Run) -> None:
    """A folder that is none, an unknown engine, an ending that is none, a run without a recording."""
    with pytest.raises(deltaswarm.Error, match="there is nothing at"):
        deltaswarm.open(tmp_path / "none")
    with pytest.raises(deltaswarm.Error, match="engine must be a known engine: one of dask, in-process, processes"):
        deltaswarm.run("smoke", engine="proceses")
    with pytest.raises(deltaswarm.Error, match=r"\.mcap"):
        run.record(tmp_path / "a.mpg")
    unrecorded = deltaswarm.run("smoke", SHORT | {"record": "off"}, progress=False)
    with pytest.raises(deltaswarm.Error, match="record must not be off"):
        _ = unrecorded.poses
    with pytest.raises(AttributeError, match="no attribute 'rnu'"):
        _ = deltaswarm.rnu  # type: ignore[attr-defined]


OWN = """
import signal
from deltaswarm_agent.controllers.potential import PotentialController

class Own(PotentialController):
    def step(self, percept):
        if percept.step == 5:
            ACT
        return super().step(percept)
"""


@pytest.mark.parametrize(
    ("module", "act", "steps", "why"),
    [
        ("pressing", "signal.raise_signal(signal.SIGINT)", 7, "stopped by SIGINT"),
        ("raising", "raise ZeroDivisionError('an own mistake')", 6, "an own mistake"),
    ],
)
def test_what_ends_a_run_early_leaves_what_there_is(
    module: str, act: str, steps: int, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C, and a controller that fails: the tables of the steps done, and a warning that says why."""
    (tmp_path / f"{module}.py").write_text(OWN.replace("ACT", act))
    monkeypatch.syspath_prepend(tmp_path)
    keys = {"control.mode": f"{module}:Own", "agents.count": 1, "record": "off"}
    with pytest.warns(UserWarning, match=why):
        run = deltaswarm.run("smoke", keys, seed=1, progress=False)
    assert not run.is_valid
    assert len(run.series) == steps
    assert run.events["arrived_s"].max() < steps


def test_keys_are_what_set_takes() -> None:
    """Tables are merged, NumPy's numbers and paths are plain, a class is its name."""
    keys = {
        "radio": {"loss": np.float64(0.25), "asymmetry": {"dead_share": 0}},
        "events.density": {"kind": "grid", "file": Path("a") / "b.npy"},
        "fault": [{"kind": "kill", "at_s": 1, "agents": (1, np.int64(2))}],
        "run.ask_every_step": True,
        "control.mode": PotentialController,
        "radio.models": {PurePath: {}},
        "operator.page": {},
        "run.duration_s": math.inf,
        "uplink.base_m": np.array([10.0, 20.0]),
        "events.rates_s": np.array([3]),
        "name": 'a "quoted" \\ näme',
    }
    assert overrides(keys) == [
        "radio.loss=0.25",
        "radio.asymmetry.dead_share=0",
        'events.density.kind="grid"',
        'events.density.file="a/b.npy"',
        'fault=[{"kind" = "kill", "at_s" = 1, "agents" = [1, 2]}]',
        "run.ask_every_step=true",
        'control.mode="deltaswarm_agent.controllers.potential:PotentialController"',
        'radio.models."pathlib:PurePath"={}',
        "run.duration_s=inf",
        "uplink.base_m=[10.0, 20.0]",
        "events.rates_s=[3]",
        'name="a \\"quoted\\" \\\\ näme"',
    ]
    with pytest.raises(deltaswarm.Error, match=r"run\.step_s must be a number, a text"):
        overrides({"run.step_s": object()})

    class Local:
        pass

    with pytest.raises(deltaswarm.Error, match=r"control\.mode must be a class at the top level of a module"):
        overrides({"control.mode": Local})


def test_a_density_may_be_a_function(tmp_path: Path) -> None:
    """Events occur where it is positive, and the run can be repeated from its folder."""
    keys = SHORT | {"run.duration_s": 200.0, "events.rate_hz": 1.0, "events.density": lambda x, y: x > 30 and y < 10}
    run = deltaswarm.run("smoke", keys, out=tmp_path / "run", progress=False)
    assert len(run.events) > 100
    assert run.events["x_m"].between(30, 40).all()
    assert run.events["y_m"].between(0, 10).all()
    with pytest.raises(deltaswarm.Error, match="run exists"):
        deltaswarm.run("smoke", keys | {"events.density": lambda x, y: x < 10}, out=tmp_path / "run", progress=False)
    again = deltaswarm.run(tmp_path / "run" / "scenario.toml", progress=False)
    assert again.digest == run.digest
    for wrong in (lambda x: x, lambda x, y: 1 / 0, lambda x, y: x - 1, lambda x, y: float("nan"), lambda x, y: 0.0):
        with pytest.raises(deltaswarm.Error, match=rf"events\.density (must|failed).*{__file__}:"):
            deltaswarm.run("smoke", {"events.density": wrong})


NOTEBOOK = """
import deltaswarm
from deltaswarm_agent.controllers.potential import PotentialController

class Mine(PotentialController):
    pass

run = deltaswarm.run("smoke", {"control.mode": Mine, "run.duration_s": 20.0, "record": "off"}, seed=1, progress=False)
same = deltaswarm.run("smoke", {"control.mode": "potential", "run.duration_s": 20.0}, seed=1, progress=False)
print(run.digest == same.digest, run.manifest["controller"]["mode"], len(run.manifest["controller"]["source"]))
for engine in ("processes", "dask"):
    try:
        deltaswarm.run("smoke", {"control.mode": Mine}, engine=engine, scheduler="tcp://127.0.0.1:1")
    except deltaswarm.Error as error:
        print(error)
table = deltaswarm.sweep("SWEEP", {"run.duration_s": 20.0}, jobs=2, progress=False)
print(list(table["variant"]), table["digest_in_process"].nunique())
"""


PAIR = 'repeats = 1\nprove = 0\naxes.control.mode = ["hybrid", "potential"]\n'


def test_what_a_script_defines_is_taken_in_one_process_alone(tmp_path: Path) -> None:
    """A class of `__main__`, from standard input as from a notebook; no worker of a sweep runs the script again."""
    (tmp_path / "s.toml").write_text('schema = 1\nname = "s"\nbase = "smoke"\n[sweep]\n' + PAIR)
    code = NOTEBOOK.replace("SWEEP", "s.toml")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-"], input=code, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    refusal = "control.mode must name a class that other processes can import, in a file of its own: engine is {!r}; "
    assert done.stdout.splitlines() == [
        "True __main__:Mine 16",
        *(refusal.format(engine) + "'in-process' takes it as it is" for engine in ("processes", "dask")),
        "['mode=hybrid', 'mode=potential'] 2",
    ], done.stderr
    (tmp_path / "script.py").write_text(code)
    script = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert script.stdout == done.stdout, script.stderr


def test_each_public_name_is_what_type_checkers_see() -> None:
    """Every name of the package can be loaded, and is one of those that are imported for type checkers."""
    text = Path(deltaswarm.__file__).read_text()
    for name in deltaswarm.WHERE:
        assert getattr(deltaswarm, name).__name__ == name
        assert f"import {name} as {name}" in text
    assert set(deltaswarm.__all__) <= set(dir(deltaswarm))


def test_importing_the_package_loads_next_to_nothing() -> None:
    """Neither pandas nor NumPy nor Zenoh: the command line is built on it."""
    code = "import sys, deltaswarm; print(sorted({'pandas', 'numpy', 'zenoh', 'rich'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, run: deltaswarm.Run) -> None:
    """Without pandas a run can be done, and its tables say what to install."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    other = deltaswarm.open(run.folder)
    with pytest.raises(deltaswarm.Error, match=r"run.events needs pandas: pip install 'deltaswarm\[study\]'"):
        _ = other.events
    assert json.loads((run.folder / "summary.json").read_text())["digest"] == other.digest
