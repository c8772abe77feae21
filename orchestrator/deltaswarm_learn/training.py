"""Training of the rule that chooses delta: CMA-ES over tasks, with the same result on any number of processes.

Each generation draws new tasks, the same for all candidates. A candidate's cost is the geometric mean over them of its
cost by that of hybrid control with delta 3, at the task's price. Every few generations the mean of the search is
validated on tasks that are always the same; the best by validation is the result.

What a generation's candidates cost is kept in a log, from which an interrupted training goes on.
"""

import json
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from importlib.metadata import version
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from statistics import fmean, geometric_mean
from typing import Any

import numpy as np
from cmaes import CMA

from deltaswarm_agent.controllers.paper.policy import INPUTS, OUTPUTS, WEIGHTS, policy_of, shipped
from deltaswarm_learn.costs import Cost, Keys, cost_of
from deltaswarm_learn.tasks import TRAINING, VALIDATION, task
from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.kernel import signal_at_parents_death
from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.digest import of_numbers
from deltaswarm_wire.files import write_whole

PRICE = "control.message_price"

HYBRID: Keys = {"delta_rule": "fixed", "delta": 3}
"""The control that costs are divided by."""

APART = 1_000_000
"""Numbers of training tasks between two seeds."""

FINE = 0.2
"""First step size of the weights of experience, as a share of that of the constants and of the weights of the price:
else the random steps of the many hide what the few do, which is most."""

FIRST_STEPS = [1.0 if name in ("constant", "price") else FINE for name in ("constant", *INPUTS)] * len(OUTPUTS)


def learned(weights: Sequence[float]) -> Keys:
    """Return the control by a policy."""
    return {"delta_rule": "learned", "policy": list(weights)}


def policy_in(file: Path | None) -> tuple[float, ...]:
    """Return the numbers of a policy's file, by default of the shipped one; raises OSError and ValueError."""
    return policy_of(json.loads(file.read_text(encoding="utf-8"))) if file else shipped()


def _versions() -> dict[str, str | None]:
    return provenance.versions() | {"cmaes": version("cmaes"), "numba": version("numba")}


@dataclass(frozen=True)
class TrainingSettings:
    """What decides the result of a training."""

    seed: int = 1
    population: int = 32
    tasks: int = 16
    """Tasks of a generation."""
    sigma: float = 0.3
    validate_every: int = 4
    validation_tasks: int = 40
    overrides: tuple[str, ...] = ()
    """Keys of the scenario, the same in all tasks, as `key=value`."""


def _ratios(costs: np.ndarray, hybrid: np.ndarray) -> np.ndarray:
    """Divide the costs of tasks by those of hybrid control, without the tasks that have no event and cost nothing."""
    have_events = hybrid[:, 0] > 0
    if not have_events.any():
        must = "must be great enough, or run.duration_s long enough, that tasks have events"
        raise SettingsError([Problem("events.rate_hz", "tasks without an event", must)])
    return np.asarray(costs[have_events] / hybrid[have_events])


class Pool:
    """Processes that do the runs, and end with this one, however that ends."""

    def __init__(self, workers: int, overrides: tuple[str, ...]) -> None:
        self._overrides = overrides
        begin = signal.SIGKILL, os.getpid()
        self._executor = ProcessPoolExecutor(workers, get_context("spawn"), signal_at_parents_death, begin)

    def costs(self, stream: str, numbers: Sequence[int], controls: Sequence[Keys]) -> np.ndarray:
        """Return what each task costs under each control, at the task's price: (tasks, controls)."""
        tasks = [task(stream, number) for number in numbers for _ in controls]
        with starting_processes():
            found: Iterator[Cost] = self._executor.map(
                cost_of, tasks, repeat(self._overrides), list(controls) * len(numbers)
            )
        costs = [cost.at(keys[PRICE]) for keys, cost in zip(tasks, found, strict=True)]
        return np.array(costs).reshape(len(numbers), len(controls))

    def close(self) -> None:
        self._executor.shutdown(cancel_futures=True)


class Training:
    """A training, with the log of it in a file.

    Raises:
        SettingsError: the log is that of another training, or by other code.
    """

    def __init__(self, settings: TrainingSettings, log: Path, pool: Pool) -> None:
        self.settings, self._pool, self._log = settings, pool, log
        self._search = CMA(
            np.zeros(WEIGHTS),
            settings.sigma,
            seed=settings.seed,
            population_size=settings.population,
            cov=np.diag(np.square(FIRST_STEPS)),
        )
        self.generation = 0
        self.curve: list[tuple[int, float]] = []
        """Generations after which the search was validated, and the mean cost."""
        self.best: tuple[float, tuple[float, ...]] = np.inf, (0.0,) * WEIGHTS
        self._baseline: np.ndarray | None = None
        self._resume()

    def _resume(self) -> None:
        head = json.dumps(
            {"settings": asdict(self.settings), "code": provenance.code_digest(), "versions": _versions()}
        )
        text = self._log.read_text(encoding="ascii", errors="replace") if self._log.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        first, *rows = whole.splitlines() or [head if head.startswith(text) else text]
        if first != head:
            must = "must be the log of this training by this code; give the same options, or remove it"
            raise SettingsError([Problem(str(self._log), first[:200], must)])
        for number, row in enumerate(rows, 2):
            try:
                found = json.loads(row)
                self._take(self._candidates(), found["costs"])
            except (ValueError, KeyError, TypeError):
                must = "must be as a training wrote it; restore it, or remove this row and all below it"
                raise SettingsError([Problem(f"{self._log}, line {number}", row[:60], must)]) from None
            if "validated" in found:
                self._compare(found["validated"])
        if whole != text or not whole:  # a last row that was cut off is done again
            write_whole(self._log, (whole or f"{head}\n").encode())

    def _candidates(self) -> list[np.ndarray]:
        return [self._search.ask() for _ in range(self.settings.population)]

    def _take(self, candidates: Sequence[np.ndarray], costs: Sequence[float]) -> None:
        self._search.tell(list(zip(candidates, costs, strict=True)))
        self.generation += 1

    def _compare(self, validated: float) -> None:
        self.curve.append((self.generation, validated))
        if validated < self.best[0]:
            self.best = validated, tuple(self._search.mean.tolist())

    @property
    def _next_task(self) -> int:
        return self.settings.seed * APART + self.generation * self.settings.tasks

    def advance(self) -> tuple[float, float]:
        """Do a generation; return the least and the mean cost of its candidates."""
        settings, candidates = self.settings, self._candidates()
        first, controls = self._next_task, [HYBRID, *(learned(found.tolist()) for found in candidates)]
        costs = self._pool.costs(TRAINING, range(first, first + settings.tasks), controls)
        means = np.exp(np.log(_ratios(costs[:, 1:], costs[:, :1])).mean(axis=0)).tolist()
        self._take(candidates, means)
        row: dict[str, Any] = {"costs": means}
        if self.generation % settings.validate_every == 0:
            row["validated"] = geometric_mean(self.validated(learned(self._search.mean.tolist())))
            self._compare(row["validated"])
        with self._log.open("a", encoding="ascii") as log:
            log.write(f"{json.dumps(row)}\n")
        return min(means), fmean(means)

    def validated(self, control: Keys) -> list[float]:
        """Return what each validation task with events costs under a control, by hybrid control with delta 3."""
        numbers = range(self.settings.validation_tasks)
        if self._baseline is None:
            self._baseline = self._pool.costs(VALIDATION, numbers, [HYBRID])
        return list(_ratios(self._pool.costs(VALIDATION, numbers, [control]), self._baseline)[:, 0])

    def record(self, command: str) -> dict[str, Any]:
        """Return the file of the best policy, with where it comes from; `command` makes it again."""
        settings, (validated, weights) = self.settings, self.best
        origin = {
            "command": command,
            "commit": provenance.commit(),
            "versions": _versions(),
            "settings": asdict(settings),
            "generations": self.generation,
            "training_tasks": f"{TRAINING} {settings.seed * APART} to {self._next_task - 1}",
            "validation_tasks": f"{VALIDATION} 0 to {settings.validation_tasks - 1}",
            "validated": validated,
            "curve": self.curve,
        }
        policy = {"inputs": INPUTS, "weights": weights, "digest": of_numbers(weights)}
        return policy | {"training": origin}
