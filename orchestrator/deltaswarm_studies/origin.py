"""Where a study's runs come from, and whether its file or the code have changed since then."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_orchestrator.sweeps.job import Task, work
from deltaswarm_orchestrator.sweeps.table import read_table, row_of, series_of
from deltaswarm_studies.metrics import ID
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import ORIGIN, runs_of

PROVENANCE = {"what": "What", "value": "Value"}
"""Columns of the table of where runs come from, with their headings."""

BEGUN = "begun"
DONE, WALL = "runs", "wall time of all sessions"
CODE, RUNS, QUESTIONS = "digest of the code", "digest of what the study runs", "digest of what the study asks"

WITH_THE_RUNS = "with the runs"
"""When tables were sealed that `deltaswarm study` or `deltaswarm report` wrote after the runs."""


def facts_of(table: pd.DataFrame) -> dict[str, str]:
    """Return a table of where runs come from as a mapping."""
    return dict(zip(table["what"], table["value"].astype(str), strict=True))


def sealed_tables(folder: Path, study: Study | None = None) -> dict[str, Any]:
    """Check the tables of a study, and return their sealed record; {} if they are not sealed."""
    record = seal.checked(folder / seal.RECORD)
    if record and study and record.get("study") != study.name:
        raise seal.SealError(f"{folder} must hold the study {study.name!r} (got {record.get('study')!r})")
    return record


def seal_tables(study: Study, provenance: pd.DataFrame, folder: Path, files: Sequence[Path], sealed: str) -> None:
    """Seal the tables of a study's runs; `sealed` says since when they are."""
    record = {"study": study.name, "sealed": sealed, "origin": facts_of(provenance)}
    seal.write_sealed(folder / seal.RECORD, record, seal.digests(folder, [file.name for file in files]))


def since_the_runs(study: Study, recorded: pd.DataFrame, sealed: str) -> pd.DataFrame:
    """Make rows that say which code makes the page, and what may have changed since the runs: study file and tables."""
    then, code = facts_of(recorded), provenance.code_digest()
    changed = [
        words
        for what, words, now in zip((RUNS, QUESTIONS), ("what it runs", "what it asks"), study.digests, strict=True)
        if what in then and then[what] != now
    ]
    state = f"changed since the runs: {' and '.join(changed)}" if changed else "unchanged since the runs"
    rows = {
        "page by code": f"{code}, {'that of the runs' if then.get(CODE) == code else 'not that of the runs'}",
        "study file": state if RUNS in then else "not known whether it has changed since the runs",
        "tables": f"sealed {sealed}" if sealed else "not sealed: not known whether they have changed since the runs",
    }
    return pd.DataFrame(list(rows.items()), columns=[*PROVENANCE])


def begun_of(recorded: pd.DataFrame) -> str:
    """Return when a study's runs began; empty if that is not recorded."""
    return facts_of(recorded).get(BEGUN, "")


def provenance_of(study: Study, manifest: dict[str, Any]) -> pd.DataFrame:
    """Make a table of where a study's runs come from, from its sweep's manifest.

    Raises:
        ValueError: the manifest is not as `deltaswarm sweep` writes it.
    """
    try:
        proofs = manifest["proofs"]
        rows = {
            DONE: f"{manifest['finished']} of {manifest['runs']}, by {manifest['means']}",
            BEGUN: manifest["started"],
            WALL: f"{manifest['wall_s'] / 60:.1f} min",
            "machine": f"{manifest['host']['cores']} cores, {manifest['host']['system']}",
            "versions": ", ".join(f"{name} {number}" for name, number in manifest["versions"].items() if number),
            "commit": manifest.get("commit") or "not known",
            CODE: ", ".join(manifest["code"]),
            **dict(zip((RUNS, QUESTIONS), study.digests, strict=True)),
            "digest of the sweep": manifest["digest"] or "not all runs are there",
            "repeated with real processes": f"{proofs['checked']} runs, {proofs['equal']} with the same digest",
        }
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"manifest.json is not as `deltaswarm sweep` writes it: {error!r}") from None
    return pd.DataFrame(list(rows.items()), columns=[*PROVENANCE])


def run_s(provenance: pd.DataFrame) -> float | None:
    """Return the wall time of a study's runs, divided by their number [s]; None if it is not known."""
    told = facts_of(provenance)
    try:
        return 60 * float(told[WALL].partition(" ")[0]) / int(told[DONE].partition(" ")[0])
    except (KeyError, ValueError, ZeroDivisionError):
        return None


class Repeated(NamedTuple):
    """A run that was repeated, and each column in which it differs: name, published value, value now."""

    run: str
    differing: list[tuple[str, Any, Any]]


def repeat(study: Study, folder: Path) -> Repeated:
    """Repeat one of a study's runs, in one process, and compare it with its row in `runs.csv`.

    Which one depends on the code, so that successive versions try different variants and replicates.

    Raises:
        OSError: there is no `runs.csv`.
        SealError: a table is not as it was sealed.
        ValueError: `runs.csv` is no table of this study.
        RunError: the run failed.
    """
    sealed_tables(folder, study)
    file = folder / "runs.csv"
    published = read_table(file, ["variant", *ORIGIN, *study.factors], needs=ID)
    if published.empty:
        raise ValueError(f"{file} must have at least one run")
    row = published.iloc[int(provenance.code_digest(), 16) % len(published)]
    wanted = row["variant"], row["seed"]
    jobs = [job for job in study.sweep.jobs() if (job.variant.label, job.scenario.seed) == wanted]
    if not jobs:
        raise ValueError(f"{file} must have runs of the study (got {wanted[0]!r} with seed {wanted[1]})")
    result = work(Task(jobs[0]))
    now = runs_of(study, row_of(jobs[0], result), series_of([(jobs[0], result)])).iloc[0]
    shared = [(name, row[name], now[name]) for name in now.index if name in row.index]
    return Repeated(jobs[0].name, [(name, was, value) for name, was, value in shared if not _is_same(was, value)])


def _is_same(was: Any, now: Any) -> bool:
    if isinstance(was, str) or isinstance(now, str):
        return bool(was == now)
    return bool(was == now) or (math.isnan(was) and math.isnan(now))
