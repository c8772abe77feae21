"""A sweep on a real Dask cluster: a scheduler and two workers, each a process of its own."""

import gc
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import pytest

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.sweeps.job import work
from tests.support.dask_clusters import Cluster, dask_cluster
from tests.support.swarms import BOUND_S, wait_until
from tests.support.sweeping import RunningSweep, all_gone, made, marked, sweep, sweeping, tasks_of, written
from tests.support.tiers import first_of

distributed = pytest.importorskip("distributed")

from deltaswarm_cluster.sweep_engine import DaskEngine, attempt_with, check_workers  # noqa: E402
from deltaswarm_orchestrator.base import provenance  # noqa: E402  # nothing of it without Dask
from deltaswarm_orchestrator.sweeps.engine import EngineError  # noqa: E402


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with dask_cluster(tmp_path / "cluster") as made_here:
        yield made_here


@contextmanager
def on(cluster: Cluster, file: Path, out: Path) -> Iterator[RunningSweep]:
    with sweeping(file, out, "--engine", "dask", "--scheduler", cluster.address) as running:
        yield running


@pytest.mark.processes
@pytest.mark.slow
def test_the_loss_of_a_worker_costs_only_what_ran_there(cluster: Cluster, tmp_path: Path) -> None:
    """Killed with -9 in mid-sweep: the other does its runs, and the table is the local one's, bit for bit."""
    file = written(tmp_path, duration_s=150.0, repeats=3, prove=1)
    victim, _ = cluster.add_worker(), cluster.add_worker()
    with on(cluster, file, tmp_path / "out") as running:
        running.wait_for_runs(2)
        victim.kill()
        code, printed, errors = running.finish()
    assert code == 0, errors
    assert "9 of 9 runs" in printed
    assert cluster.workers[1].poll() is None
    sweep(file, tmp_path / "local")
    assert (tmp_path / "out" / "table.csv").read_bytes() == (tmp_path / "local" / "table.csv").read_bytes()


@pytest.mark.processes
@pytest.mark.slow
def test_the_loss_of_the_scheduler_is_said_and_costs_only_what_is_missing(cluster: Cluster, tmp_path: Path) -> None:
    """In one line and exit code 1; what is finished is in the table, and the next call does the rest."""
    file = written(tmp_path, duration_s=300.0, repeats=20)
    cluster.add_worker()
    with on(cluster, file, tmp_path / "out") as running:
        running.wait_for_runs(2)
        cluster.scheduler.kill()
        code, printed, errors = running.finish()
        assert code == 1
        assert re.search(f"{cluster.address} .*lost", errors)
        assert "Traceback" not in errors
        assert f"{running.finished()} of 60 runs" in printed
        assert 2 <= running.finished() < 60


@pytest.mark.processes
def test_a_cluster_without_workers_is_waited_for(cluster: Cluster, tmp_path: Path) -> None:
    """And that is said: they may be in a queue. Ctrl-C ends the waiting."""
    with on(cluster, written(tmp_path), tmp_path / "out") as running:
        assert running.process.stderr is not None
        said = running.process.stderr.readline()
        assert re.match(f"deltaswarm: .*{cluster.address} .*no workers", said)
        running.process.send_signal(signal.SIGINT)
        code, _, errors = running.finish(BOUND_S)
        assert code == 130
        assert "0 of 6 runs" in errors
        assert "Traceback" not in errors


def test_only_the_same_code_does_a_run() -> None:
    """By a digest of all sources."""
    (task,) = tasks_of(made({"axes": {"control.delta": [2]}, "repeats": 1}))
    result, reason, _ = attempt_with(provenance.code_digest(), task)
    assert reason == ""
    assert result is not None
    assert result["summary"] == work(task)["summary"]
    result, reason, _ = attempt_with("0" * 16, task)
    assert result is None
    assert provenance.code_digest() in reason
    assert "0" * 16 in reason


@pytest.mark.processes
def test_a_result_of_other_code_that_a_scheduler_still_has_is_not_taken(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two versions may share a scheduler, and ask it for the same run."""
    cluster.add_worker()
    sweep = {"axes": {"control.delta": [2]}, "repeats": 1}
    with monkeypatch.context() as other:
        other.setattr(provenance, "code_digest", lambda: "0" * 16)
        theirs = DaskEngine(cluster.address, 1).run(tasks_of(made(sweep)))
        assert next(theirs).result is None
    try:
        (ours,) = DaskEngine(cluster.address, 1).run(tasks_of(made(sweep)))  # while the scheduler keeps what they got
    finally:
        theirs.close()
    assert ours.reason == ""
    assert ours.result is not None


def clients() -> int:
    """How many of Dask's clients are not closed, in use or not."""
    found = [one for one in gc.get_objects() if issubclass(type(one), distributed.Client)]  # `isinstance` asks proxies
    return sum(client.status != "closed" for client in found)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", "tcp://127.0.0.1:notaport", "ftp://127.0.0.1:9"])
def test_no_scheduler_at_the_address_is_an_error(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it is nobody's address or none at all; no client is left that would be closed in a thread of the next."""
    before = clients()
    monkeypatch.setattr("deltaswarm_cluster.sweep_engine.CONNECT_WITHIN_S", 0.5)
    with pytest.raises(EngineError, match=address):
        list(DaskEngine(address, 1).run(tasks_of(made({"axes": {"control.delta": [2]}}))))
    assert clients() == before


def test_the_command_ends_with_2_without_a_scheduler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line; the folder can be used again."""
    monkeypatch.setattr("deltaswarm_cluster.sweep_engine.CONNECT_WITHIN_S", 0.5)
    arguments = ["sweep", str(written(tmp_path, repeats=1)), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--engine", "dask", "--scheduler", "tcp://127.0.0.1:9"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("deltaswarm: ")
    assert "tcp://127.0.0.1:9" in line
    assert main([*arguments, "-j", "1"]) == 0


@pytest.mark.parametrize("command", [("sweep", "loss.toml"), ("run", "smoke", "--scheduler", "tcp://127.0.0.1:9")])
def test_without_dask_the_line_says_how_to_install_it(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """For a sweep and for a run; nothing is written."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    words = [str(written(tmp_path)) if word == "loss.toml" else word for word in command]
    assert main([*words, "--engine", "dask", "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "deltaswarm: engine dask needs distributed: pip install 'deltaswarm[cluster]'"
    assert not (tmp_path / "out").exists()


@pytest.mark.processes
@pytest.mark.parametrize("number", first_of([signal.SIGKILL, signal.SIGINT]))
def test_nothing_is_left_of_a_local_cluster(
    tmp_path: Path, number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the sweep is interrupted or killed in mid-run: no process, and no file outside its own folder."""
    file = written(tmp_path, duration_s=1e7)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    with sweeping(file, tmp_path / "out", "--engine", "dask", "-j", "2") as running:
        wait_until(lambda: len(marked(running.mark)) >= 3, "the workers")
        running.process.send_signal(number)
        code, _, errors = running.finish(BOUND_S)
        assert code == (130 if number == signal.SIGINT else -9)
        if number == signal.SIGINT:  # workers whose sweep was killed may complain of it
            assert "Traceback" not in errors
        all_gone(running.mark)
    assert not list((tmp_path / "temporary").glob("*dask*"))


class Having:
    """A client of workers that have these versions of deltaswarm, or None."""

    def __init__(self, versions: list[str | None]) -> None:
        self._versions = versions

    def get_versions(self, packages: object) -> dict[str, Any]:
        host = {"python": "3.11.7.final.0"}
        found = [{"host": host, "packages": {"deltaswarm": version}} for version in self._versions]
        return {"workers": {f"tcp://there:{port}": has for port, has in enumerate(found)}}


def check(*versions: str | None) -> None:
    check_workers(cast(Any, Having([*versions])), "tcp://there:8786")


def test_workers_without_deltaswarm_are_refused() -> None:
    """They would end at the first run, with nobody told."""
    with pytest.raises(EngineError, match=r"must have deltaswarm .*tcp://there:1"):
        check("0.1", None)


def test_a_scheduler_without_workers_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """So that nobody waits for what nobody does."""
    check("0.1")
    assert capsys.readouterr().err == ""
    check()
    assert "tcp://there:8786 has no workers yet" in capsys.readouterr().err


@pytest.mark.parametrize(("workers", "started"), [(1, 1), (2, 2), (1000, 2)])
def test_a_local_cluster_has_no_spare_workers_and_says_if_one_dies(
    workers: int, started: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many are asked for; one that dies at the start is told in a line."""

    def killed(**options: Any) -> None:
        assert options["n_workers"] == started
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr("deltaswarm_cluster.sweep_engine.LocalCluster", killed)
    with pytest.raises(EngineError, match="on this machine: Nanny failed to start"):
        list(DaskEngine(None, workers).run(tasks_of(made({"axes": {"control.delta": [2, 3]}, "repeats": 1}))))
