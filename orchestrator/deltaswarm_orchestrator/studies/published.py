"""Repeat a run of published tables, to see whether today's code still gives the same numbers."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.studies.metrics import ID
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_orchestrator.studies.tables import ORIGIN, runs_of
from deltaswarm_orchestrator.sweeps.job import Task, work
from deltaswarm_orchestrator.sweeps.plan import Job
from deltaswarm_orchestrator.sweeps.table import read_table, row_of, series_of


class Repeated(NamedTuple):
    """A run that was repeated, and each column in which it differs: name, published value, value now."""

    run: str
    differing: list[tuple[str, Any, Any]]


def repeat(study: Study, folder: Path) -> Repeated:
    """Repeat a run of the study's cheapest variant, in one process, and compare it with its row in `runs.csv`.

    Which of the replicates it is depends on the code, so that successive versions try different ones.

    Raises:
        OSError: there is no `runs.csv`.
        ValueError: `runs.csv` is no table of this study.
        RunError: the run failed.
    """
    file = folder / "runs.csv"
    published = read_table(file, ["variant", *ORIGIN, *study.factors], needs=ID)
    variant = min(study.sweep.variants, key=lambda one: one.scenario.agents.count * one.scenario.run.steps)
    rows = published[published["variant"] == variant.label]
    if rows.empty:
        raise ValueError(f"{file} must have runs of {variant.label!r}, which is cheapest to repeat")
    row = rows.iloc[int(provenance.code_digest(), 16) % len(rows)]
    jobs = [job for job in study.sweep.jobs() if job.variant is variant and job.scenario.seed == row["seed"]]
    if not jobs:
        raise ValueError(f"{file} must have the study's seeds (got {row['seed']} for replicate {row['replicate']})")
    return Repeated(jobs[0].name, _differing(study, jobs[0], row))


def _differing(study: Study, job: Job, published: "pd.Series[Any]") -> list[tuple[str, Any, Any]]:
    result = work(Task(job))
    now = runs_of(study, row_of(job, result), series_of([(job, result)])).iloc[0]
    shared = [name for name in now.index if name in published.index]
    return [(name, published[name], now[name]) for name in shared if not _is_same(published[name], now[name])]


def _is_same(was: Any, now: Any) -> bool:
    if isinstance(was, str) or isinstance(now, str):
        return bool(was == now)
    return bool(was == now) or (math.isnan(was) and math.isnan(now))
