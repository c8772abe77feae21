"""Repeat rows of a study's table of runs, by the other engine where it can, and compare every number."""

import math
import random
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.processes.elsewhere import DENSE, PYTHON
from deltaswarm_orchestrator.run.choosing import planned_by
from deltaswarm_orchestrator.sweeps.engine import Engine
from deltaswarm_orchestrator.sweeps.job import RunError, Task
from deltaswarm_orchestrator.sweeps.plan import Job
from deltaswarm_orchestrator.sweeps.table import read_table, row_of, series_of
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.costs import with_costs
from deltaswarm_studies.metrics import ID
from deltaswarm_studies.origin import ENGINES, facts_of, sealed_tables
from deltaswarm_studies.protocol import seeded
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import ORIGIN, runs_of


def told(checked: Mapping[str, Any]) -> str:
    """Return what `check` found in lines for people."""
    by = ", ".join(f"{count} by {engine}" for engine, count in checked["engines"].items())
    counts = f"{checked['equal']} of {checked['repeated']} repeated rows are equal"
    left = checked["rows"] - checked["repeated"]
    others = f"; the other {left} of {checked['rows']} were not repeated" if left else ""
    rows = checked["differing"]
    return "\n".join(
        [
            f"{checked['study']}: {counts} ({by}; drawn with --seed {checked['seed']}){others}",
            *(f"  {name} differs in {count}" for name, count in Counter(row["metric"] for row in rows).items()),
            *(f"  for example {row['run']}: {row['metric']} was {row['was']}, is {row['is']}" for row in rows[:1]),
        ]
    )


def check(study: Study, folder: Path, count: int, seed: int, engine: Engine) -> dict[str, Any]:
    """Repeat `count` rows of a study's `runs.csv`; return how many were equal, and where the others differ.

    Rows are drawn at random, first at least one with each controller, kind of dynamics, radio model and plug-in.

    Raises:
        OSError: there is no `runs.csv`.
        SealError: a table is not as it was sealed.
        ValueError: `runs.csv` is no table of this study.
        RunError: a run failed.
    """
    study = seeded(study, folder)
    sealed_tables(folder, study)
    file = folder / "runs.csv"
    choices = [one.name for one in study.ranges if one.choices]
    published = read_table(file, ["variant", *ORIGIN, *study.factors, *choices], needs=ID)
    if published.empty:
        raise ValueError(f"{file} must have at least one run")
    jobs = {(job.variant.label, job.scenario.seed): job for job in study.sweep.jobs()}
    rows = list(zip(published["variant"], published["seed"], strict=True))
    if unknown := [row for row in rows if row not in jobs]:
        raise ValueError(f"{file} must have runs of the study (got {unknown[0][0]!r} with seed {unknown[0][1]})")
    places = {jobs[row].name: place for place, row in enumerate(rows)}
    chosen = drawn([jobs[row] for row in rows], count, seed)
    was = _done_by(folder)
    tasks = [Task(job, engine=other_engine(job.scenario, was)) for job in chosen]
    engines: Counter[str] = Counter()
    differing: list[dict[str, Any]] = []
    for done in engine.run(tasks):
        job = done.task.job
        if done.result is None:
            raise RunError(f"{job.name}: {done.reason}")
        engines[done.result["engine"]["by"]] += 1
        run = [(job, done.result)]
        now = runs_of(study, with_costs(study, row_of(*run[0]), run), series_of(run)).iloc[0]
        differing += _differing(job, published.iloc[places[job.name]], now)
    equal = len(chosen) - len({row["run"] for row in differing})
    counts = {"rows": len(rows), "repeated": len(chosen), "equal": equal, "seed": seed}
    return {"study": study.name, **counts, "engines": dict(engines), "differing": differing}


def drawn(jobs: Sequence[Job], count: int, seed: int) -> list[Job]:
    """Draw jobs in random order: those with something that none before has, then others, up to the count."""
    order = random.Random(seed).sample(jobs, len(jobs))
    seen: set[str] = set()
    needed = []
    for job in order:
        if new := _parts(job.scenario) - seen:
            seen |= new
            needed.append(job)
    others = [job for job in order if job not in needed]
    return [*needed, *others[: max(0, count - len(needed))]]


def _parts(scenario: Scenario) -> set[str]:
    """Return the controller, dynamics, radio models and other plug-ins of a scenario."""
    parts = {f"controller {scenario.control.mode}", f"dynamics {scenario.world.dynamics}"}
    parts |= {f"radio model {name}" for name in scenario.radio.models}
    return parts | {f"{point.what} {name}" for point, name, *_ in provenance.extensions(scenario)}


def _done_by(folder: Path) -> str:
    """Return the engine that did all runs; empty if several did. Tables of before there were two name none."""
    told = facts_of(read_table(folder / "provenance.csv")) if (folder / "provenance.csv").exists() else {}
    engines = [one.partition(" by ")[2] for one in told.get(ENGINES, f"all by {PYTHON}").split(", ")]
    return engines[0] if len(engines) == 1 else ""


def other_engine(scenario: Scenario, was: str) -> str:
    """Return an engine that can do a run and is not the one that did it; else that one."""
    if (was or planned_by(scenario).engine) == DENSE:
        return PYTHON
    try:
        return planned_by(scenario, asked=DENSE).engine
    except CommandError:
        return PYTHON


def _differing(job: Job, was: "pd.Series[Any]", now: "pd.Series[Any]") -> Iterator[dict[str, Any]]:
    for name in now.index:
        if name in was.index and not _is_same(was[name], now[name]):
            yield {"run": job.name, "metric": name, "was": was[name], "is": now[name]}


def _is_same(was: Any, now: Any) -> bool:
    if isinstance(was, str) or isinstance(now, str):
        return bool(was == now)
    return bool(was == now) or (math.isnan(was) and math.isnan(now))
