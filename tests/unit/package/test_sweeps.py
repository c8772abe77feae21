"""Tests of sweeps and studies from Python."""

import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import deltaswarm
from deltaswarm.errors import in_python
from deltaswarm_cli.main import main
from deltaswarm_orchestrator.sweeps.table import read_table

SWEEP = """
schema = 1
name = "pair"
base = "smoke"
scenario.run.duration_s = 60.0
scenario.run.step_s = 2.0
[sweep]
repeats = 2
prove = 0
axes.control.mode = ["hybrid", "potential"]
"""

STUDY = """
[study]
question = "Does hybrid control send more frames?"
factors = { mode = "Control" }
metrics = ["frames_sent"]

[[claim]]
id = "frames"
text = "Hybrid control sends more frames than virtual forces."
metric = "frames_sent"
more = "mode=hybrid"
less = "mode=potential"
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair.toml").write_text(SWEEP)
    return tmp_path / "pair.toml"


def test_a_sweep_is_that_of_the_command_line(file: Path) -> None:
    """The same runs, in the same folder: Python finds all of them done, and returns their table."""
    assert main(["sweep", str(file), "-q", "--jobs", "1"]) == 0
    before = {path: path.stat().st_mtime_ns for path in Path("sweeps/pair/runs").iterdir()}
    table = deltaswarm.sweep(file, jobs=1, progress=False)
    assert {path: path.stat().st_mtime_ns for path in Path("sweeps/pair/runs").iterdir()} == before
    assert table.attrs["folder"] == "sweeps/pair"
    kept = read_table(Path("sweeps/pair/table.csv"))
    assert list(table["digest_in_process"]) == list(kept["digest_in_process"])
    assert len(table) == 4


def test_metrics_may_be_functions_in_one_process(file: Path) -> None:
    """Each gets a run with its tables; nothing is kept, as nobody could repeat it from a file; workers are refused."""
    metrics = {
        "latest_s": lambda run: run.events["told_s"].max(),
        "sent": lambda run: run.series["frames_sent"].sum(),
        "nothing": lambda run: None,
        "completed_share": lambda run: float(np.isfinite(run.events["completed_s"]).mean()),
    }
    table = deltaswarm.sweep(file, metrics=metrics, replicates=1, progress=False)
    assert list(table["sent"]) == list(table["frames.sent"])
    assert table["nothing"].isna().all()
    assert (table["latest_s"] <= 60).all()
    assert list(table["completed_share"]) == [0.0, 0.0], "in a minute nobody completes 200 agent seconds of work"
    assert not Path("sweeps").exists()
    for given in ({"jobs": 2}, {"engine": "processes"}, {"out": "kept"}):
        with pytest.raises(deltaswarm.Error, match="must be used in one process that keeps no runs"):
            deltaswarm.sweep(file, metrics=metrics, **given)  # type: ignore[arg-type]
    with pytest.raises(deltaswarm.Error, match=r"metrics must have names of their own \(got told_s\)"):
        deltaswarm.sweep(file, metrics={"told_s": lambda run: 1.0})


def test_an_interrupted_sweep_gives_what_there_is(file: Path) -> None:
    """Ctrl-C after the first run: its row, and a warning with the number of runs that are missing."""

    def interrupt(run: deltaswarm.Run) -> float:
        interrupt.calls += 1  # type: ignore[attr-defined]
        if interrupt.calls == 2:  # type: ignore[attr-defined]
            signal.raise_signal(signal.SIGINT)
        return 1.0

    interrupt.calls = 0  # type: ignore[attr-defined]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.warns(UserWarning, match="interrupted with 1 of 4 runs"):
            table = deltaswarm.sweep(file, metrics={"one": interrupt}, progress=False)
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(table) == 1


def test_mistakes_are_errors(file: Path) -> None:
    """An unknown sweep, a swept key, no jobs."""
    with pytest.raises(deltaswarm.Error, match="did you mean 'modes'"):
        deltaswarm.sweep("mode")
    with pytest.raises(deltaswarm.Error, match="varies in this sweep, so it cannot also be given in keys"):
        deltaswarm.sweep(file, {"control.mode": "hybrid"})
    with pytest.raises(deltaswarm.Error, match=r"jobs must be an integer from 1 .*\(got 0\)"):
        deltaswarm.sweep(file, jobs=0)
    with pytest.raises(deltaswarm.Error, match="did you mean 'limits'"):
        deltaswarm.study("limts")


def test_a_study_gives_verdicts_and_a_page(file: Path) -> None:
    """Its claims, its runs and its page; what the command line would complain of is a warning."""
    file.write_text(SWEEP + STUDY)
    with pytest.warns(UserWarning, match="pair: "):
        study = deltaswarm.study(file, jobs=1, progress=False)
    assert list(study.claims["claim"]) == ["frames"]
    assert len(study.runs) == 4
    assert study.page == Path("studies/pair/page.html")
    assert study.page.exists()
    assert "<Study pair, 4 runs, claims: 1 " in repr(study)
    with pytest.warns(UserWarning, match="pair: "):
        again = deltaswarm.study(file, render=True, progress=False)
    assert list(again.claims["verdict"]) == list(study.claims["verdict"])


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: deltaswarm.sweep("smoke", {"seed": 3}), "seed is set by the sweep for each run.* given in keys"),
        (lambda: deltaswarm.sweep("smoke", out="other"), "choose another folder by out"),
        (lambda: deltaswarm.sweep("smoke", out="/proc/no/such"), "out must be a folder"),
        (lambda: deltaswarm.sweep("smoke", scheduler="tcp://127.0.0.1:1"), "scheduler is for engine dask"),
        (lambda: deltaswarm.run("smoke", scheduler="tcp://127.0.0.1:1"), "scheduler is for engine dask"),
        (lambda: deltaswarm.run("smoke", engine="dask"), "engine dask must be given with scheduler"),
        (lambda: deltaswarm.run("smoke", out="other"), "force=True"),
        (lambda: deltaswarm.run("smoke", commands="none.toml"), "commands must be a TOML file"),
        (lambda: deltaswarm.run("smoke", {"": 1}), "keys must be key=value"),
        (lambda: deltaswarm.run("smoke", {"run.bound": "density"}, engine="processes"), "engine='in-process'"),
        (lambda: deltaswarm.study("jamming", render=True, out="none"), "render=False"),
    ],
)
def test_messages_name_what_python_takes(
    call: Callable[[], object], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No message of a function has an option of the command line."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").touch()
    with pytest.raises(deltaswarm.Error, match=told) as raised:
        call()
    assert "--" not in str(raised.value)


def test_command_lines_in_messages_stay() -> None:
    """Only what is no command line is said as Python takes it."""
    told = "--out x exists: --force replaces it; to go on: deltaswarm run --out x; `deltaswarm study --plan` and --set"
    said = "out x exists: force=True replaces it; to go on: deltaswarm run --out x; `deltaswarm study --plan` and keys"
    assert in_python(told) == said
