"""A sweep from plan to tables: what is there is kept, what is missing is run, what failed is said."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import tomli_w

from deltaswarm_orchestrator import provenance
from deltaswarm_orchestrator.sweeps import table as tables
from deltaswarm_orchestrator.sweeps.engine import Engine
from deltaswarm_orchestrator.sweeps.folder import SweepFolder
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_orchestrator.sweeps.progress import SweepReporter
from deltaswarm_orchestrator.sweeps.work import IN_PROCESS, PROCESSES, Task
from deltaswarm_wire import checked


@dataclass
class SweepResult:
    """What a sweep gives its caller, finished or not."""

    folder: Path
    runs: int
    """Of the plan."""
    finished: int
    manifest: dict[str, Any]
    table: pd.DataFrame
    failed: list[str] = field(default_factory=list)
    """Runs without a result, with the reason."""
    differing: list[str] = field(default_factory=list)
    """Runs whose digest is another one by real processes than in one process."""
    interrupted: bool = False

    @property
    def is_well(self) -> bool:
        """Whether every run is there and every proof holds."""
        return self.finished == self.runs and not self.failed and not self.differing


def conduct(
    sweep: Sweep,
    path: Path,
    make_engine: Callable[[], Engine],
    reporter: SweepReporter,
    *,
    means: str = IN_PROCESS,
    with_series: bool = False,
) -> SweepResult:
    """Do what is missing of a sweep, and write its tables.

    Raises:
        SweepFolderError: the folder is in use or holds something else.
    """
    folder = SweepFolder(path)
    with folder.held(sweep.name):
        began = time.monotonic()
        before = folder.manifest() or {}
        jobs = sweep.jobs()
        manifest = _manifest(sweep, means, before)
        folder.write_manifest(manifest)
        (path / "sweep.toml").write_text(tomli_w.dumps(checked.plain(sweep.file)))
        wanted = [(job, means) for job in jobs]
        wanted += [(job, PROCESSES) for job in sweep.proofs() if means == IN_PROCESS]
        tasks = [Task(job, by, str(folder.scratch)) for job, by in wanted if not folder.has(job, by)]
        failed: list[str] = []
        interrupted = False
        reporter.begin(len(wanted), len(wanted) - len(tasks))
        try:
            if tasks:
                for done in make_engine().run(tasks):
                    if done.result is not None:
                        folder.save(done.task.job, done.task.means, done.result)
                    else:
                        failed.append(f"{done.task.job.name} ({done.task.means}): {done.reason}")
                    reporter.done(done)
        except KeyboardInterrupt:
            interrupted = True
        runs = tables.finished_runs(sweep, folder, means)
        table = tables.table_of(runs, folder)
        differing = tables.differing(table)
        manifest |= {
            "wall_s": manifest["wall_s"] + time.monotonic() - began,
            "finished": len(runs),
            "digest": tables.digest_of(runs) if len(runs) == len(jobs) else None,
            "failed": failed,
            "proofs": _proofs(table, differing),
        }
        _write(path, runs, table, with_series)
        folder.write_manifest(manifest)
    return SweepResult(path, len(jobs), len(runs), manifest, table, failed, differing, interrupted)


def _manifest(sweep: Sweep, means: str, before: dict[str, Any]) -> dict[str, Any]:
    """Where the sweep's numbers come from, before there are any."""
    code = provenance.code_digest()
    return {
        "name": sweep.name,
        "base": sweep.file.base,
        **checked.plain(sweep.file.sweep),
        "swept": sweep.swept,
        "labels": [variant.label for variant in sweep.variants],
        "runs": len(sweep.jobs()),
        "finished": 0,
        "means": means,
        "started": before.get("started", provenance.now()),
        "wall_s": float(before.get("wall_s", 0.0)),
        "sessions": int(before.get("sessions", 0)) + 1,
        "versions": provenance.versions(),
        "host": provenance.host(),
        "code": [*(found for found in before.get("code", []) if found != code), code],
        "digest": None,
        "failed": [],
        "proofs": {"checked": 0, "equal": 0},
    }


def _proofs(table: pd.DataFrame, differing: Sequence[str]) -> dict[str, int]:
    checked_runs = 0 if table.empty else len(table.dropna(subset=list(tables.DIGESTS.values())))
    return {"checked": checked_runs, "equal": checked_runs - len(differing)}


def _write(path: Path, runs: tables.Finished, table: pd.DataFrame, with_series: bool) -> None:
    tables.write_table(path / "table", table)
    tables.write_table(path / "costs", tables.costs_of(runs))
    if with_series:
        tables.write_table(path / "series", tables.series_of(runs))


def default_workers(means: str) -> int:
    """A core for each run in one process; two for each run by processes."""
    cores = len(os.sched_getaffinity(0))
    return cores if means == IN_PROCESS else max(1, cores // 2)
