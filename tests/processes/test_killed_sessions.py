"""`kill -9` of a session, or of what starts a local Dask cluster, leaves no process behind, at whatever stage."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.processes.test_asking_again import FILE, PROCESSES, Browser, a_session, end_well, table
from tests.support.swarms import BOUND_S, COMMAND, told, wait_until
from tests.support.sweeping import marked, marked_command, sweeping, written

pytestmark = pytest.mark.processes

REPLAYING = 4
"""The command, its fork server, what feeds the page, and the page."""


@contextmanager
def session(folder: Path, ending: signal.Signals) -> Iterator[subprocess.Popen[str]]:
    """A session that gets a signal at the end of the block, and of which nothing may be left then."""
    command = [*COMMAND, "session", str(folder / "study.toml"), "--quiet", "--participant", "1"]
    command += [*PROCESSES, "--out", str(folder / "sessions" / "study")]
    (folder / "sessions" / "study" / "participant-001" / "station.json").unlink(
        missing_ok=True
    )  # of one that was killed
    with marked_command(*command, DISPLAY="") as (process, mark):
        yield process
        assert process.poll() is None
        process.send_signal(ending)
        wait_until(lambda: not marked(mark), "the end of all its processes", BOUND_S)


def test_a_killed_session_leaves_no_process(tmp_path: Path) -> None:
    """While processes start, while a page is open, and while it asks again; answers given afterwards count once."""
    (tmp_path / "study.toml").write_text(FILE)
    out = tmp_path / "sessions" / "study" / "participant-001"
    committed = told("session", str(tmp_path / "study.toml"), "--freeze", "--out", str(out.parent))
    with session(tmp_path, signal.SIGKILL):
        wait_until((out / "0-training.part" / "logs" / "pids.json").exists, "the first processes")
    with session(tmp_path, signal.SIGKILL):
        wait_until((out / "0-training-2.part" / "operator.toml").exists, "what the operator is told")
    with session(tmp_path, signal.SIGTERM):
        training = Browser(out, tlx=True, condition="0 training")
        Browser(out, tlx=False, condition="1 A", after=training)
    with session(tmp_path, signal.SIGKILL):
        wait_until((out / "1-A.again-1").exists, "the page that asks again")
        second = told("session", str(tmp_path / "study.toml"), "--participant", "1", "--out", str(out.parent))
        assert (second.returncode, "under way" in second.stderr) == (2, True)
    (out / "station.json").unlink(missing_ok=True)
    with a_session(tmp_path) as last:
        asked = Browser(out, tlx=True).asked
        end_well(last)
    assert asked == ["tlx", "form"]
    [run] = [row for row in table(tmp_path, "runs") if row["run"] == "1-A"]
    assert (run["answers_missing"], run["tlx_raw"]) == ("0", "30.0")
    training = [row for row in table(tmp_path, "runs") if row["condition"] == "training"]
    assert [(row["attempt"], row["complete"]) for row in training] == [("1", "0"), ("2", "0"), ("3", "1")]
    verified = told("verify", str(out.parent), "--against", committed.stdout.split()[0])
    assert (verified.returncode, "2 of 2 planned runs are complete" in verified.stdout) == (0, True), verified.stdout


def test_a_killed_replay_leaves_no_process(tmp_path: Path) -> None:
    """Neither what feeds its page nor the page's own process."""
    run = tmp_path / "run"
    assert told("run", "smoke", "--in-process", "--set", "run.duration_s=5", "--out", str(run)).returncode == 0
    with marked_command(*COMMAND, "replay", str(run)) as (process, mark):
        wait_until(lambda: len(marked(mark)) >= REPLAYING, "all processes of the replay")
        process.kill()
        wait_until(lambda: not marked(mark), "the end of all its processes", BOUND_S)


def test_a_sweep_that_is_killed_while_its_cluster_starts_leaves_no_process(tmp_path: Path) -> None:
    """Neither scheduler nor workers."""
    pytest.importorskip("distributed")
    with sweeping(written(tmp_path, duration_s=1e7), tmp_path / "out", "--engine", "dask", "--jobs", "2") as running:
        wait_until(lambda: len(marked(running.mark)) > 1, "the first process of the cluster")
        os.kill(running.process.pid, signal.SIGKILL)
        wait_until(lambda: not marked(running.mark), "the end of all processes", BOUND_S)
