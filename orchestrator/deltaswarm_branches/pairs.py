"""Run the remainder of a run twice from one saved state, with and without a change: as it was, and in replicates."""

import os
import pickle
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_branches.plan import Plan
from deltaswarm_branches.repetition import Repetition
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.kernel import signal_at_parents_death
from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_orchestrator.processes.elsewhere import PYTHON
from deltaswarm_orchestrator.results.metric import Metric
from deltaswarm_orchestrator.results.metrics import METRICS
from deltaswarm_orchestrator.results.outcome import Outcome, RunData
from deltaswarm_orchestrator.run.choosing import DoneBy
from deltaswarm_orchestrator.run.randomness import replicate_seed
from deltaswarm_scenario.scenario import Scenario

MEASURES = {
    "waiting": "waiting_time_s.restricted_mean",
    "told": "told_s.mean",
    "completed": "completed",
    "messages": "reports.arrived",
}
"""The metric of the summary by the name of each measure: all of them over the whole run."""

BY_KEY: dict[str, Metric] = {metric.key: metric for metric in METRICS}

Measured = dict[str, float | None]


class Pair(NamedTuple):
    """What was measured with a change and without it, with the same random draws."""

    comparison: int
    """Its place among the comparisons."""
    replicate: int
    """0: the run's own randomness."""
    with_it: Measured
    without: Measured
    by: Sequence[DoneBy] = ()
    """The engines of both runs."""


class Comparison(NamedTuple):
    """Two ways in which a run may go on from one step."""

    with_it: Plan
    without: Plan


@dataclass(frozen=True)
class Work:
    """All that a worker process needs."""

    repetition: Repetition
    comparisons: Sequence[Comparison]
    asked: str = ""
    """The engine that is insisted on; empty: the dense one where it can."""

    def pair(self, comparison: int, replicate: int) -> Pair:
        """Do both runs of a pair.

        Raises:
            InputsChangedError: a file that decides them is not as it was when they were planned.
        """
        plans, scenario = self.comparisons[comparison], self.repetition.parent.scenario
        for plan in plans:
            plan.check_inputs()
        seed = replicate and replicate_seed(scenario.seed, plans.with_it.at_step, replicate)
        (with_it, one), (without, other) = [self._outcome(plan, seed) for plan in plans]
        for plan in plans:
            plan.check_inputs()
        return Pair(comparison, replicate, measured(with_it, scenario), measured(without, scenario), (one, other))

    def _outcome(self, plan: Plan, seed: int) -> tuple[Outcome, DoneBy]:
        if (
            not seed
            and not plan.changes_console
            and not plan.restarts_agents
            and self.repetition.parent.digest is not None
        ):
            return self.repetition.past, DoneBy(PYTHON, "the run was repeated to its end")
        outcome, by = self.repetition.finish(plan, seed or None, self.asked)
        if outcome.messages:
            raise CommandError("; ".join(outcome.messages), FAILED)
        return outcome, by


def measured(outcome: Outcome, scenario: Scenario) -> Measured:
    """Return each measure of a run; None where nothing could be measured."""
    run = RunData(outcome, scenario)
    computes = {name: BY_KEY[key].compute for name, key in MEASURES.items()}
    return {name: compute(run) if compute else None for name, compute in computes.items()}


def engines(found: Sequence[Pair]) -> dict[str, Any]:
    """Count the runs of each engine, for JSON; say why some were not done by the dense one."""
    done_by = [by for pair in found for by in pair.by]
    because = sorted({by.because for by in done_by} - {""})
    return {"engines": dict(Counter(by.engine for by in done_by)), **({"because": because} if because else {})}


def pairs(work: Work, replicates: int, jobs: int, done: Callable[[int, int], None]) -> list[Pair]:
    """Do all pairs, side by side in `jobs` processes; return them in order. `done` gets how many of how many are.

    Raises:
        CommandError: a run failed.
    """
    wanted = [(place, number) for place in range(len(work.comparisons)) for number in range(replicates + 1)]
    found = []
    here = (work.pair(*key) for key in wanted)
    for pair in here if jobs == 1 else _in_processes(work, wanted, jobs):
        found.append(pair)
        done(len(found), len(wanted))
    return sorted(found, key=lambda pair: pair[:2])


def _in_processes(work: Work, wanted: Sequence[tuple[int, int]], jobs: int) -> Iterator[Pair]:
    with tempfile.TemporaryFile() as file:  # it has no name, so that nothing is left if this process is killed
        file.write(pickle.dumps(work))
        file.flush()
        here = os.getpid()
        arguments = here, Path(f"/proc/{here}/fd/{file.fileno()}")
        pool = ProcessPoolExecutor(min(jobs, len(wanted)), get_context("spawn"), _Worker.begin, arguments)
        try:
            with starting_processes():
                futures = [pool.submit(_Worker.pair, *key) for key in wanted]
            for future in as_completed(futures):
                yield future.result()
        except BrokenProcessPool as error:
            raise CommandError(f"a worker was killed; fewer --jobs need less memory ({error})", FAILED) from None
        finally:
            pool.shutdown(cancel_futures=True)


class _Worker:
    """A worker process, which loads its work once and ends with the command, however that ends."""

    work: Work

    @classmethod
    def begin(cls, parent: int, file: Path) -> None:
        """Load the work."""
        signal_at_parents_death(signal.SIGKILL, parent)
        cls.work = pickle.loads(file.read_bytes())

    @classmethod
    def pair(cls, comparison: int, replicate: int) -> Pair:
        """Do a pair."""
        return cls.work.pair(comparison, replicate)
