"""Training of the rule for delta: what a run costs, and a search that anybody can repeat or go on with."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from deltaswarm_agent.controllers.paper.policy import WEIGHTS, policy_of
from deltaswarm_cli.main import main
from deltaswarm_learn import costs
from deltaswarm_learn.costs import Cost, Keys, cost_of
from deltaswarm_learn.tasks import TRAINING, VALIDATION
from deltaswarm_learn.training import HYBRID, Pool, Training, TrainingSettings, learned
from deltaswarm_orchestrator.base import provenance
from deltaswarm_wire.checked import SettingsError
from tests.support.swarms import is_running, wait_until

SMALL = TrainingSettings(seed=3, population=8, tasks=2, validate_every=2, validation_tasks=3)


class Bowl:
    """In place of runs: the nearer the first number of delta is to 1, the less a policy costs; a task is a factor."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, list[int]]] = []

    def costs(self, stream: str, numbers: Sequence[int], controls: Sequence[Keys]) -> np.ndarray:
        self.asked.append((stream, list(numbers)))
        heights = [2.0 if control == HYBRID else 1.0 + (control["policy"][0] - 1.0) ** 2 for control in controls]
        return np.outer([1.0 + number for number in numbers], heights)


def trained(log: Path, generations: int, settings: TrainingSettings = SMALL) -> tuple[Training, Bowl]:
    bowl = Bowl()
    training = Training(settings, log, bowl)  # type: ignore[arg-type]
    while training.generation < generations:
        training.advance()
    return training, bowl


def test_delays_end_with_the_run_and_messages_are_per_event(monkeypatch: pytest.MonkeyPatch) -> None:
    """One event is told after 20 s and complete after 60, one only told after 50 s, one never: of a run of 200 s."""
    events = [(1, 10.0, 70.0), (2, 100.0, None), (3, 150.0, None)]
    outcome = SimpleNamespace(
        events=[SimpleNamespace(event=n, arrived_s=a, completed_s=c) for n, a, c in events],
        told_s={1: 30.0, 2: 150.0},
        workloads=[SimpleNamespace(messages=m) for m in (4, 0, 5)],
    )
    monkeypatch.setattr(costs, "run_dense", lambda _: outcome)
    monkeypatch.setattr(costs, "compile_once", lambda *_: None)
    cost = cost_of({"run.duration_s": 200.0}, (), {})
    assert cost == Cost(pytest.approx((40.0 + 75.0 + 50.0) / 3), 3.0)
    assert cost.at(2.0) == pytest.approx(61.0)


def test_keys_that_are_wrong_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(costs, "compile_once", lambda *_: None)
    with pytest.raises(SettingsError, match="control\\.delta_rule must be one of"):
        cost_of({}, ["control.delta_rule=learnt"], {})


def test_training_finds_what_costs_least(tmp_path: Path) -> None:
    training, bowl = trained(tmp_path / "log", 60)
    assert training.best[0] == pytest.approx(0.5, abs=0.01)
    assert training.best[1][0] == pytest.approx(1.0, abs=0.2)
    assert training.best[0] == min(cost for _, cost in training.curve)
    own = [numbers for stream, numbers in bowl.asked if stream == TRAINING]
    assert own == [[3_000_000 + 2 * k, 3_000_001 + 2 * k] for k in range(60)]
    assert {tuple(numbers) for stream, numbers in bowl.asked if stream == VALIDATION} == {(0, 1, 2)}


class Uneven:
    """In place of runs: any policy costs four times as much as hybrid control in every other task, else a quarter."""

    def costs(self, stream: str, numbers: Sequence[int], controls: Sequence[Keys]) -> np.ndarray:
        ratios = [4.0 if number % 2 else 0.25 for number in numbers]
        return np.array([[1.0 if control == HYBRID else ratio for control in controls] for ratio in ratios])


def test_costs_of_tasks_are_averaged_as_ratios(tmp_path: Path) -> None:
    training = Training(replace(SMALL, validation_tasks=2), tmp_path / "log", Uneven())  # type: ignore[arg-type]
    assert training.advance() == pytest.approx((1.0, 1.0))
    training.advance()
    assert training.curve == [(2, pytest.approx(1.0))]


class Empty(Uneven):
    """No event comes in the first task, which costs nothing."""

    def __init__(self, *empty: int) -> None:
        self._empty = empty

    def costs(self, stream: str, numbers: Sequence[int], controls: Sequence[Keys]) -> np.ndarray:
        found = super().costs(stream, numbers, controls)
        found[[number % 1000 in self._empty for number in numbers]] = 0.0
        return found


def test_tasks_without_events_say_nothing(tmp_path: Path) -> None:
    """Of two tasks the odd one is left, in which a policy costs four times as much; if none is, training is refused."""
    settings = replace(SMALL, validation_tasks=2, validate_every=1)
    training = Training(settings, tmp_path / "log", Empty(0))  # type: ignore[arg-type]
    assert training.advance() == pytest.approx((4.0, 4.0))
    assert training.best[0] == pytest.approx(4.0)
    with pytest.raises(SettingsError, match="tasks have events"):
        Training(settings, tmp_path / "other", Empty(0, 1)).advance()  # type: ignore[arg-type]


def test_weights_of_the_price_begin_with_greater_steps(tmp_path: Path) -> None:
    training, _ = trained(tmp_path / "log", 0, replace(SMALL, population=400))
    of_delta, of_working = np.split(np.std(training._candidates(), axis=0) / SMALL.sigma, 2)
    for constant, *experience, price in (of_delta, of_working):
        assert [constant, price] == pytest.approx([1.0, 1.0], abs=0.15)
        assert experience == pytest.approx([0.2] * 10, abs=0.03)


@pytest.mark.parametrize("stopped", [1, 4, 5])
def test_an_interrupted_training_goes_on_as_if_it_had_not_been(tmp_path: Path, stopped: int) -> None:
    whole, _ = trained(tmp_path / "whole", 8)
    trained(tmp_path / "log", stopped)
    resumed, bowl = trained(tmp_path / "log", 8)
    assert resumed.record("c") == whole.record("c")
    assert len([stream for stream, _ in bowl.asked if stream == TRAINING]) == 8 - stopped
    assert (tmp_path / "log").read_text() == (tmp_path / "whole").read_text()
    assert len(policy_of(resumed.record("c"))) == WEIGHTS


@pytest.mark.parametrize("kept", [0, 10, -1, -30])
def test_a_log_that_was_cut_off_loses_its_last_row_alone(tmp_path: Path, kept: int) -> None:
    """Also if nothing but the beginning of its first row is left."""
    trained(tmp_path / "log", 4)
    whole = (tmp_path / "log").read_text()
    (tmp_path / "log").write_text(whole[:kept])
    trained(tmp_path / "log", 4)
    assert (tmp_path / "log").read_text() == whole


def test_a_log_that_was_edited_is_named_by_its_line(tmp_path: Path) -> None:
    trained(tmp_path / "log", 3)
    rows = (tmp_path / "log").read_text().splitlines()
    for wrong in ('{"cost": []}', '{"costs": [1.0]}', "[]", "x"):
        (tmp_path / "log").write_text("\n".join([*rows[:2], wrong, *rows[3:]]) + "\n")
        with pytest.raises(SettingsError, match="log, line 3 must be as a training wrote it"):
            trained(tmp_path / "log", 4)


def test_the_log_of_another_training_is_refused(tmp_path: Path) -> None:
    trained(tmp_path / "log", 1)
    with pytest.raises(SettingsError, match="must be the log of this training"):
        trained(tmp_path / "log", 2, TrainingSettings(seed=4))


def test_the_log_of_a_training_by_other_code_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its costs are those of another swarm, or its search took other steps."""
    trained(tmp_path / "log", 1)
    monkeypatch.setattr(provenance, "code_digest", lambda: "0123456789abcdef")
    with pytest.raises(SettingsError, match="by this code"):
        trained(tmp_path / "log", 2)


@pytest.mark.slow
def test_any_number_of_processes_finds_the_same() -> None:
    controls: list[Any] = [HYBRID, learned([0.0] * WEIGHTS), learned([0.2] * WEIGHTS)]
    found = []
    for workers in (1, 2):
        pool = Pool(workers, ("run.duration_s=300",))
        found.append(pool.costs(TRAINING, range(3), controls).tolist())
        pool.close()
    assert found[0] == found[1]
    assert all(row[0] == row[1] != row[2] for row in found[0])


WAITING = """
import os, signal
from deltaswarm_learn.training import Pool
executor = Pool(1, ())._executor
worker = executor.submit(os.getpid).result()
busy = executor.submit(signal.pause)
while not busy.running(): pass
print(worker, flush=True)
signal.pause()
"""


def test_workers_end_with_a_training_that_is_killed() -> None:
    """In the middle of a run, too."""
    with subprocess.Popen([sys.executable, "-c", WAITING], stdout=subprocess.PIPE, text=True) as training:
        try:
            assert training.stdout
            worker = int(training.stdout.readline())
            assert is_running(worker)
        finally:
            training.kill()
    wait_until(lambda: not is_running(worker), "the worker's end")


def test_a_training_that_would_validate_nothing_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Else its file would hold a policy that nobody tried, at an infinite cost."""
    out = tmp_path / "policy.json"
    assert main(["learn", "delta", "--generations", "3", "--out", str(out)]) == 2
    assert "--generations must be at least --validate-every, 4" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_what_could_not_be_written_or_learned_is_refused_before_a_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Else the runs were done for nothing."""
    for what in ("delta", "inputs"):
        assert main(["learn", what, "--out", str(tmp_path)]) == 2
        assert "--out must be a file" in capsys.readouterr().err
        out = str(tmp_path / "new" / "file")
        assert main(["learn", what, "--set", "control.mode=decentralised", "--out", out]) == 2
        assert "control.mode must be one that chooses delta" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
