"""`deltaswarm sweep` as a process: interrupted, killed, twice at once, and what it leaves."""

import contextlib
import json
import os
import random
import re
import signal
import subprocess
from pathlib import Path

import pytest

from deltaswarm_cli.main import main
from tests.support.swarms import heeds, wait_until
from tests.support.sweeping import LOSSES, all_gone, marked, sweep, sweeping, written
from tests.support.tiers import first_of

pytestmark = pytest.mark.processes

IS_LONG = "DELTASWARM_LONG" in os.environ
REPEATS, KILLS = (40, 10) if IS_LONG else (3, 6)
"""Of the sweep that is killed again and again: three times so many runs and a proof."""


def table(out: Path) -> bytes:
    return (out / "table.csv").read_bytes()


@pytest.mark.parametrize("number", first_of([signal.SIGINT, signal.SIGTERM, signal.SIGHUP]))
def test_a_signal_ends_a_sweep_in_order(tmp_path: Path, number: signal.Signals) -> None:
    """Soon, with exit code 130: the table has what is finished, the rest is said to be missing, no process is left."""
    file = written(tmp_path, duration_s=200.0, repeats=1000)
    with sweeping(file, tmp_path / "out", "-j", "2") as running:
        running.wait_for_runs(2)
        running.process.send_signal(number)
        code, printed, errors = running.finish()
        assert code == 130
        assert "Traceback" not in errors
        assert " of 3000 runs; " in errors.splitlines()[-1]
        assert " of 3000 runs in " in printed
        all_gone(running.mark)
    assert len(table(tmp_path / "out").splitlines()) == running.finished() + 1 >= 3
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["finished"], manifest["digest"]) == (running.finished(), None)


@pytest.mark.parametrize("engine", ["local", "dask"])
@pytest.mark.parametrize("workers", first_of([3, 1]))
def test_a_terminals_ctrl_c_while_workers_start(tmp_path: Path, engine: str, workers: int) -> None:
    """It reaches all processes at once, also those that have just begun: one line, no traceback of any."""
    file = written(tmp_path, duration_s=1e7)
    with sweeping(file, tmp_path / "out", "--engine", engine, "-j", str(workers)) as running:
        wait_until(lambda: sum(map(heeds, marked(running.mark))) == 1 + workers, "the workers' processes")
        os.killpg(running.process.pid, signal.SIGINT)
        code, _, errors = running.finish()
        said = [line for line in errors.splitlines() if not line.startswith("compiled cores would save")]
        assert (code, len(said)) == (130, 1), errors
        all_gone(running.mark)


@pytest.mark.parametrize("number", first_of([signal.SIGTERM, signal.SIGHUP]))
def test_a_signal_ends_a_sweep_in_order_before_its_first_run_too(tmp_path: Path, number: signal.Signals) -> None:
    """From when it handles signals on, to when its workers start: exit code 130 and one line."""
    with sweeping(written(tmp_path, duration_s=1e7), tmp_path / "out", "-j", "1") as running:
        wait_until(lambda: heeds(running.process.pid, number), "Python")
        running.process.send_signal(number)
        code, _, errors = running.finish()
        said = [line for line in errors.splitlines() if not line.startswith("compiled cores would save")]
        assert (code, len(said)) == (130, 1), errors


@pytest.mark.slow
def test_two_sweeps_do_not_touch_each_other(tmp_path: Path) -> None:
    """On one machine at once, each gives what it gives alone; on one folder, the second is refused."""
    file = written(tmp_path, repeats=3)
    another = ("smoke", tmp_path / "b", "--set", "run.duration_s=100", "--repeats", "1")
    alone = sweep(file, tmp_path / "alone")
    with sweeping(file, tmp_path / "a", "-j", "1") as one, sweeping(*another, "-j", "1") as other:
        wait_until((tmp_path / "a" / "manifest.json").exists, "the first sweep's folder")
        with sweeping(file, tmp_path / "a") as second:
            code, _, errors = second.finish()
            assert (code, str(tmp_path / "a") in errors, errors.count("\n")) == (2, True, 1)
        for running in (one, other):
            code, _, errors = running.finish()
            assert code == 0, errors
    assert table(tmp_path / "a") == table(tmp_path / "alone")
    assert json.loads((tmp_path / "a" / "manifest.json").read_text())["digest"] == alone["digest"]


@pytest.mark.slow
def test_a_sweep_that_is_killed_again_and_again_has_the_same_table_in_the_end(tmp_path: Path) -> None:
    """Killed with -9 at random moments, at first while it starts, and resumed: bit for bit; no process is left."""
    moments = random.Random(4711)
    file = written(tmp_path, duration_s=100.0, repeats=REPEATS, prove=1)
    results = len(LOSSES) * REPEATS + 1
    undisturbed = sweep(file, tmp_path / "undisturbed", "--series")
    finished = []
    for count in [0, 0, *sorted(moments.sample(range(1, results * 2 // 3), KILLS - 2))]:
        with sweeping(file, tmp_path / "out", "--series") as running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                running.process.wait(moments.uniform(0, 1))
            wait_until(lambda count=count, running=running: running.finished() >= count, f"{count} runs")
            running.process.kill()
            all_gone(running.mark)
            finished.append(running.finished())
    in_between = [count for count in finished if 0 < count < results]
    assert len(in_between) >= 3, f"kills that hit nothing prove nothing: {finished}"
    manifest = sweep(file, tmp_path / "out", "--series")
    assert manifest["digest"] == undisturbed["digest"]
    for name in ("table.csv", "series.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "undisturbed" / name).read_bytes(), name
    assert len(list((tmp_path / "out" / "runs").glob("*.json"))) == results
    assert not (tmp_path / "out" / "scratch").exists()


# What it prints


def test_results_go_to_standard_output_and_the_rest_beside_it(tmp_path: Path) -> None:
    """With --json, standard output is one document; on a pipe, progress comes in lines with the time left."""
    with sweeping(written(tmp_path, repeats=1), tmp_path / "out", "--json") as running:
        code, printed, errors = running.finish()
    assert code == 0
    found = json.loads(printed)
    assert (found["well"], found["finished"], found["folder"]) == (True, 3, str(tmp_path / "out"))
    assert errors.splitlines()[-1] == "mine: 3 of 3 runs, 0:00:00 left"
    with sweeping(written(tmp_path, repeats=1), tmp_path / "out") as running:
        code, printed, errors = running.finish()
    assert (code, re.findall(r"\d+", errors)) == (0, ["3", "3"])
    assert printed.splitlines()[0].startswith("3 of 3 runs in ")
    assert printed.splitlines()[-1] == str(tmp_path / "out" / "table.csv")


def test_an_engine_that_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With exit code 2 and the option's name, and nothing made."""
    command = ["sweep", "smoke", "--out", str(tmp_path / "out")]
    assert main([*command, "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "--scheduler" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main([*command, "-j", "0"])
    assert ended.value.code == 2
    assert "--jobs" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
