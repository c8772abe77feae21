"""Worker processes: what they give back, what happens when they are killed, and that none is left."""

import contextlib
import json
import os
import re
import signal
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltaswarm_orchestrator.sweeps import engine as engines
from deltaswarm_orchestrator.sweeps import job as jobs
from deltaswarm_orchestrator.sweeps.engine import Done, LocalEngine, attempt
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES, DisturbedError, Result, RunError, Task, work
from tests.support.swarms import kill, wait_until
from tests.support.sweeping import MARK, all_gone, made, marked, sweeping, tasks_of, written

ENDLESS = {"run.duration_s": 1e7}
ONE: dict[str, Any] = {"axes": {"control.delta": [2]}, "repeats": 1}


@pytest.fixture
def mark(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """What the processes of one test are known by; whatever the test does, none is left."""
    found = uuid.uuid4().hex
    monkeypatch.setenv(MARK, found)
    yield found
    kill(marked(found))


def kept(result: Result | None) -> dict[str, Any]:
    """A result without what another machine or hour would change, as its file has it."""
    assert result is not None
    return {name: value for name, value in json.loads(json.dumps(result)).items() if name != "cost"}


def by_label(done: list[Done]) -> dict[str, Done]:
    assert len({one.task.job.name for one in done}) == len(done)
    return {one.task.job.variant.label: one for one in done}


@contextmanager
def killing(pids: Callable[[], list[int]], times: int, number: signal.Signals = signal.SIGKILL) -> Iterator[list[int]]:
    """Beside the test: send a signal once to each of the first processes that turn up, this many times."""
    killed: list[int] = []
    ended = threading.Event()

    def kill() -> None:
        while not ended.wait(0.02) and len(killed) < times:
            with contextlib.suppress(OSError):  # a process may end while it is looked at
                for pid in [pid for pid in pids() if pid not in killed][:1]:
                    os.kill(pid, number)
                    killed.append(pid)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        yield killed
    finally:
        ended.set()
        thread.join()


def runs(mark: str) -> list[int]:
    """The `deltaswarm run` processes of sweeps."""
    return [pid for pid in marked(mark) if b"base.dies_with_parent" in Path(f"/proc/{pid}/cmdline").read_bytes()]


# One attempt


@pytest.mark.parametrize(
    ("error", "calls", "reason"),
    [
        (RunError("not valid: x"), 1, "not valid: x"),
        (OSError("no disk"), 1, "OSError: no disk"),
        (DisturbedError("agents lost: [3]"), 2, "2 times disturbed; the last time agents lost: [3]"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_only_what_the_machine_disturbed_is_tried_again(
    error: Exception, calls: int, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that fails by itself would fail again; either way the reason is told."""
    tried: list[Task] = []

    def fail(task: Task, look: object) -> Result:
        tried.append(task)
        raise error

    monkeypatch.setattr(engines, "work", fail)
    (task,) = tasks_of(made(ONE))
    result, said, _ = attempt(task)
    assert (result, len(tried)) == (None, calls)
    assert reason in said


@pytest.mark.parametrize(
    ("cause", "calls"), [("controller boom:Boom failed in step 4: boom", 1), ("killed by signal 9", 2)]
)
def test_a_controller_that_raises_is_no_disturbance(cause: str, calls: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """By processes, too: the run is not done again, and nothing says that it was disturbed; a lost process may be."""
    summary = {"invalid_because": [f"agent 0: {cause}"], "agents_failed": [{"agent": 0, "cause": cause}]}
    tried: list[object] = []
    monkeypatch.setattr(jobs, "_run_awake", lambda command: (tried.append(command), (1, json.dumps(summary), ""))[1])
    [task] = tasks_of(made(ONE), PROCESSES)
    result, said, _ = attempt(task)
    assert (result, len(tried), "disturbed" in said) == (None, calls, calls == 2)
    assert cause in said


# Workers


@pytest.mark.processes
def test_workers_give_what_one_process_gives(mark: str) -> None:
    """Every run once; nothing but the cost depends on who did it. None of them is left."""
    tasks = tasks_of(made({"axes": {"radio.loss": [0.0, 0.3]}, "repeats": 2, "series_every_s": 20.0}))
    done = list(LocalEngine(2).run(tasks))
    assert sorted(one.task.job.name for one in done) == sorted(task.job.name for task in tasks)
    for one in done:
        assert one.reason == ""
        assert kept(one.result) == kept(work(one.task))
    assert marked(mark) == []


@pytest.mark.processes
def test_more_workers_than_runs_do_no_harm(mark: str) -> None:
    assert len(list(LocalEngine(9).run(tasks_of(made(ONE))))) == 1
    assert list(LocalEngine(2).run([])) == []
    assert marked(mark) == []


@pytest.mark.processes
def test_a_run_whose_worker_was_killed_is_done_once_more(mark: str) -> None:
    """SIGKILL: the result is there, and is what it would have been."""
    tasks = tasks_of(made({"axes": {"radio.loss": [0.0, 0.3]}, "repeats": 1}, scenario={"run.duration_s": 300.0}))
    with killing(lambda: marked(mark), 1) as killed:
        done = list(LocalEngine(1).run(tasks))
    assert len(killed) == 1
    assert [kept(one.result) for one in done] == [kept(work(one.task)) for one in done]
    assert len(done) == 2


@pytest.mark.processes
@pytest.mark.parametrize("means", [IN_PROCESS, PROCESSES])
def test_a_run_whose_process_is_stopped_is_woken(means: str, tmp_path: Path, mark: str) -> None:
    """A worker, or the `deltaswarm run` that it waits for: the result is there, as if nothing had happened."""
    (job,) = made(ONE, scenario={"run.duration_s": 300.0}).jobs()

    def stoppable() -> list[int]:
        return marked(mark) if means == IN_PROCESS else runs(mark)

    with killing(stoppable, 1, signal.SIGSTOP) as stopped:
        (done,) = LocalEngine(1).run([Task(job, means, str(tmp_path))])
    assert len(stopped) == 1
    assert done.result is not None, done.reason
    assert kept(done.result)["summary"]["digest"] == work(Task(job))["summary"]["digest"]


@pytest.mark.processes
def test_a_run_whose_worker_is_killed_each_time_is_reported_once(mark: str) -> None:
    """With the reason; the others are done all the same."""
    variants = [{"label": "fatal", **ENDLESS}, {"label": "a", "control.delta": 2}, {"label": "b", "control.delta": 3}]
    tasks = tasks_of(made({"variants": variants, "repeats": 1}))
    with killing(lambda: marked(mark), 2) as killed:
        done = by_label(list(LocalEngine(1).run(tasks)))
    assert len(killed) == 2
    assert done["fatal"].result is None
    assert re.search("signal 9.* 2 times", done["fatal"].reason)
    assert kept(done["a"].result) == kept(work(tasks[1]))
    assert done["b"].result is not None
    assert len(done) == 3


@pytest.mark.processes
def test_a_run_that_fails_is_reported_with_its_error(tmp_path: Path, mark: str) -> None:
    """Here: the density's file went away after it was identified. The same worker does the next run."""
    grid = tmp_path / "grid.csv"
    np.savetxt(grid, np.eye(3), delimiter=",")
    variants = [
        {"label": "grid", "events.density.kind": "grid", "events.density.file": str(grid)},
        {"label": "other", "control.delta": 2},
    ]
    tasks = tasks_of(made({"variants": variants, "repeats": 1}))
    assert all(task.job.key for task in tasks)
    grid.unlink()
    done = by_label(list(LocalEngine(1).run(tasks)))
    assert done["grid"].result is None
    assert str(grid) in done["grid"].reason
    assert done["other"].result is not None


@pytest.mark.processes
def test_giving_up_ends_all_workers_at_once(mark: str) -> None:
    """When the caller wants no more results, what is under way is given up: here, runs without end."""
    variants = [{"label": "a", **ENDLESS}, {"label": "b", **ENDLESS, "control.delta": 2}, {"label": "short"}]
    jobs = made({"variants": variants, "repeats": 1}).jobs()
    running = LocalEngine(3).run([Task(job) for job in jobs])
    assert next(running).task.job.variant.label == "short"
    assert len(marked(mark)) == 3
    running.close()  # type: ignore[attr-defined]  # it is a generator
    assert marked(mark) == []


# Real agent processes


@pytest.mark.processes
def test_giving_up_ends_the_swarms_of_real_processes_too(tmp_path: Path, mark: str) -> None:
    """World, operator and agents of a run that nobody waits for."""
    endless, short = made({"variants": [{"label": "a", **ENDLESS}, {"label": "short"}], "repeats": 1}).jobs()
    running = LocalEngine(2).run([Task(endless, PROCESSES, str(tmp_path)), Task(short, IN_PROCESS)])
    assert next(running).result is not None
    wait_until(lambda: len(marked(mark)) >= 11, "worker, run, fork server, world, operator, six agents")
    running.close()  # type: ignore[attr-defined]  # it is a generator
    all_gone(mark)


@pytest.mark.processes
@pytest.mark.parametrize("means", [[], ["--processes"]], ids=["in-process", "processes"])
def test_nothing_outlives_a_sweep_that_is_killed(tmp_path: Path, means: list[str]) -> None:
    """Killed with -9, which it cannot tell anybody: workers, runs and all their agents end by themselves."""
    file = written(tmp_path, duration_s=1e7)
    expected = 1 + 2 * 10 if means else 1 + 2
    with sweeping(file, tmp_path / "out", "-j", "2", *means) as running:
        wait_until(lambda: len(marked(running.mark)) >= expected, "all processes")
        running.process.kill()
        all_gone(running.mark)
