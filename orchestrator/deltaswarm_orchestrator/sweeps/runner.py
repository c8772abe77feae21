"""Conduct a sweep: keep finished runs, do the missing ones, and write the tables."""

import itertools
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Any

import pandas as pd
import tomli_w
from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

from deltaswarm_orchestrator.base import inputs, provenance, seal
from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, OK
from deltaswarm_orchestrator.base.inputs import InputsChangedError
from deltaswarm_orchestrator.run.progress import Bar
from deltaswarm_orchestrator.sweeps import table as tables
from deltaswarm_orchestrator.sweeps.engine import Done, Engine, EngineLostError
from deltaswarm_orchestrator.sweeps.folder import SweepFolder, SweepFolderError
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES, Task
from deltaswarm_orchestrator.sweeps.load import with_absolute_grids
from deltaswarm_orchestrator.sweeps.plan import Job, Sweep, flattened
from deltaswarm_orchestrator.sweeps.table import InvalidRun, invalid_run
from deltaswarm_wire import checked
from deltaswarm_wire.files import write_whole

PLAN = "sweep.toml"
"""The sweep's own file in its folder."""

SPEED_OVER_S = 3600.0
"""The time left is estimated from the last hour, because runs are long."""


class SweepReporter:
    """Receives the progress of a sweep. This base class ignores it."""

    def announce(self, total: int, finished: int) -> None: ...

    def count(self, done: Done) -> None: ...


class SweepDisplay(Bar, SweepReporter):
    def __init__(self, name: str) -> None:
        columns = BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
        super().__init__(name, *columns, speed_estimate_period=SPEED_OVER_S)
        self._name = name
        self._began = time.monotonic()
        self._total = self._before = self._ended = self._failed = 0

    def announce(self, total: int, finished: int) -> None:
        self._total, self._before = total, finished
        if finished:
            print(f"{self._name}: {finished} of {total} runs are done already", file=sys.stderr, flush=True)

    def count(self, done: Done) -> None:
        self._ended += 1
        self._failed += done.result is None
        failed = f", {self._failed} failed" if self._failed else ""
        missing = self._total - self._before - self._ended
        left = timedelta(seconds=round((time.monotonic() - self._began) / self._ended * missing))
        self._show(
            f"{self._name}: {self._before + self._ended} of {self._total} runs{failed}, {left} left",
            is_last=not missing,
            brief=f"{self._name}{failed}",
            total=self._total - self._before,
            completed=self._ended,
        )


@dataclass
class SweepResult:
    folder: Path
    runs: int
    """Runs that were asked for."""
    finished: int
    """Runs of these that are finished."""
    manifest: dict[str, Any]
    table: pd.DataFrame
    series: pd.DataFrame
    """Empty unless it was asked for."""
    kept: tables.Finished = field(default_factory=list)
    """The finished runs with all that is kept of each."""
    failed: list[str] = field(default_factory=list)
    """Runs without a result, and an engine that was lost, with the reason."""
    invalid: list[InvalidRun] = field(default_factory=list)
    """Runs that have failed or are not valid, and so are no replicates."""
    differing: list[str] = field(default_factory=list)
    """Runs whose digests by real processes and in one process differ."""
    damaged: list[str] = field(default_factory=list)
    """Files of runs that were truncated or changed, and are not used."""
    interrupted: bool = False

    @property
    def has_all_but_invalid(self) -> bool:
        """Whether there are runs, none that is missing could be done, and every proof holds."""
        done = set(zip(self.table["variant"], self.table["replicate"], strict=True)) if len(self.table) else set()
        lacking = {(row["variant"], row["replicate"]) for row in self.invalid} - done
        is_over = self.finished + len(lacking) == self.runs
        return bool(done) and is_over and not (self.differing or self.interrupted)

    @property
    def code(self) -> int:
        return OK if self.is_well else INTERRUPTED if self.interrupted else FAILED

    @property
    def is_well(self) -> bool:
        """Whether every run is there and every proof holds."""
        return self.finished == self.runs and not (self.failed or self.differing or self.interrupted)


def run_sweep(
    sweep: Sweep,
    path: Path,
    make_engine: Callable[[], Engine],
    reporter: SweepReporter,
    *,
    means: str = IN_PROCESS,
    asked: str = "",
    with_series: bool = False,
    with_events: bool = False,
) -> SweepResult:
    """Do the missing runs of a sweep, and write tables of all finished runs.

    Raises:
        SweepFolderError: the folder is in use, holds something else, or only runs of other sweeps.
    """
    folder = SweepFolder(path)
    with folder.held(sweep.name):
        began = time.monotonic()
        before = folder.manifest() or {}
        jobs = sweep.jobs()
        wanted = [(job, means) for job in jobs]
        wanted += [(job, PROCESSES) for job in sweep.sample(jobs) if means == IN_PROCESS]
        # Two labels may stand for the same variant: its run is done once, and is in the rows of both.
        files = {folder.file(job, by): (job, by) for job, by in reversed(wanted)}
        wanted = list(files.values())[::-1]
        tasks = [Task(job, by, str(folder.scratch), asked) for job, by in wanted if not folder.has(job, by)]
        kept: dict[Path, list[tuple[Job, str]]] = {}
        for run in itertools.product(jobs, (IN_PROCESS, PROCESSES)):
            kept.setdefault(folder.file(*run), []).append(run)
        damaged = [str(file) for file, runs in kept.items() if folder.is_damaged(*runs[0])]
        manifest = _manifest(sweep, means, before, does_runs=bool(tasks))
        _refuse_to_replace(sweep, folder, before, manifest)
        folder.write_manifest(manifest, {name: was for name, was in seal.files_of(before).items() if name != PLAN})
        plan = with_absolute_grids(checked.plain(sweep.file), sweep.beside)  # it is read where it lies
        write_whole(path / PLAN, tomli_w.dumps(plan).encode())
        reporter.announce(len(wanted), len(wanted) - len(tasks))
        failed, rows, interrupted = _do(tasks, folder, make_engine, reporter)
        invalid = {_run_of(row): row for row in [*before.get("invalid", []), *rows]}
        missing = {folder.file(*run) for run in wanted if not folder.has(*run)}
        invalid = _of_all_labels(invalid, [runs for file, runs in kept.items() if file in missing])
        runs = tables.finished_runs(sweep, folder)
        table = tables.table_of(runs, folder)
        with_series |= (path / "series.csv").exists()  # else it would have fewer runs than the table
        series = tables.series_of(runs) if with_series else pd.DataFrame()
        differing = tables.differing(table)
        manifest |= {
            "wall_s": manifest["wall_s"] + time.monotonic() - began,
            "finished": len(runs),
            "digest": tables.digest_of(runs) if len(runs) == manifest["runs"] else None,
            "failed": failed,
            "invalid": [*invalid.values()],
            "proofs": _proofs(table, differing),
            "engines": tables.engines_of(runs),
        }
        written = {"table": table, "costs": tables.costs_of(runs), "senders": tables.senders_of(runs)}
        written |= {"series": series} if with_series else {}
        if with_events or (path / "events.csv").exists():
            written["events"] = tables.events_of(runs)
        names = [file.name for name, frame in written.items() for file in tables.write_table(path / name, frame)]
        folder.write_manifest(manifest, seal.digests(path, [PLAN, *names]))
    finished = sum(folder.has(job, means) for job in jobs)
    return SweepResult(
        folder=path,
        runs=len(jobs),
        finished=finished,
        manifest=manifest,
        table=table,
        series=series,
        kept=runs,
        failed=failed,
        invalid=[*invalid.values()],
        differing=differing,
        damaged=damaged,
        interrupted=interrupted,
    )


def _do(
    tasks: Sequence[Task], folder: SweepFolder, make_engine: Callable[[], Engine], reporter: SweepReporter
) -> tuple[list[str], list[InvalidRun], bool]:
    """Do runs and save them; return what failed, the rows of runs without a result, and whether it was interrupted."""
    failed: list[str] = []
    invalid: list[InvalidRun] = []
    try:
        for done in make_engine().run(tasks) if tasks else ():
            if done.ends_sweep:
                raise InputsChangedError(done.reason)
            if done.result is not None:
                folder.save(done.task.job, done.task.means, done.result)
            else:
                failed.append(f"{done.task.job.name} ({done.task.means}): {done.reason}")
                invalid.append(invalid_run(done.task.job, done.task.means, done.reason))
            reporter.count(done)
    except KeyboardInterrupt:
        return failed, invalid, True
    except (EngineLostError, InputsChangedError) as error:
        failed.append(str(error))
    return failed, invalid, False


def _of_all_labels(
    invalid: Mapping[tuple[Any, ...], InvalidRun], lacking: Iterable[Sequence[tuple[Job, str]]]
) -> dict[tuple[Any, ...], InvalidRun]:
    """Return rows of the runs that are lacking, for each label of a variant, though one was tried for all."""
    found: dict[tuple[Any, ...], InvalidRun] = {}
    for same in lacking:
        runs = [(job.variant.label, job.replicate, by) for job, by in same]
        rows = [invalid[run] for run in runs if run in invalid]
        found |= {run: {**row, "variant": run[0], "replicate": run[1]} for row in rows[:1] for run in runs}
    return found


def _run_of(row: InvalidRun) -> tuple[Any, ...]:
    return row["variant"], row["replicate"], row["means"]


def check_folder(sweep: Sweep, path: Path, means: str) -> None:
    """Check that a sweep may be written into a folder that exists."""
    folder = SweepFolder(path)
    folder.check(sweep.name)
    before = folder.manifest() or {}
    _refuse_to_replace(sweep, folder, before, _manifest(sweep, means, before, does_runs=False))


def _manifest(sweep: Sweep, means: str, before: dict[str, Any], *, does_runs: bool) -> dict[str, Any]:
    """Return the manifest with which a session begins: where the sweep's numbers come from."""
    code = [*before.get("code", []), *([provenance.code_digest()] if does_runs else [])]
    runs = len(sweep.jobs())
    # If this session ends before it writes its tables, those of the last session remain.
    state = before if before.get("runs") == runs else {}
    return {
        "name": sweep.name,
        "base": sweep.file.base,
        "scenario": sweep.file.scenario,
        **checked.plain(sweep.file.sweep),
        **({"sensitivity": checked.plain(sweep.file.sensitivity)} if sweep.file.sensitivity else {}),
        "swept": sweep.swept,
        "labels": [variant.label for variant in sweep.variants],
        "factors": sweep.factors,
        "runs": runs,
        "finished": state.get("finished", 0),
        "means": means,
        "started": before.get("started", provenance.now()),
        "wall_s": float(before.get("wall_s", 0.0)),
        "sessions": int(before.get("sessions", 0)) + 1,
        "versions": provenance.versions(),
        "host": provenance.host(),
        "code": list(dict.fromkeys(code)),
        "commit": provenance.commit(),
        "inputs": _inputs_of(sweep),
        "digest": state.get("digest"),
        "failed": state.get("failed", []),
        "invalid": state.get("invalid", []),
        "proofs": state.get("proofs", {"checked": 0, "equal": 0}),
    }


def _refuse_to_replace(sweep: Sweep, folder: SweepFolder, before: dict[str, Any], manifest: dict[str, Any]) -> None:
    """Refuse a sweep that shares no run with the folder, since its tables would replace those of the other sweep."""
    ours = {folder.file(job, means) for job in sweep.jobs() for means in (IN_PROCESS, PROCESSES)}
    theirs = set(folder.runs.glob("*.json"))
    if not theirs or ours & theirs:
        return
    was, now = _plan(before), _plan(manifest)
    keys = [name for name in {**was, **now} if was.get(name) != now.get(name)]
    changes = [f"{name} was {was.get(name, 'not set')}, is {now.get(name, 'not set')}" for name in keys]
    if files := inputs.differences(before.get("inputs", {}), manifest["inputs"]):
        changes.append(f"changed since: {files}")
    raise SweepFolderError(
        f"{folder.path} holds {len(theirs)} runs, none of them of this sweep "
        f"({'; '.join(changes) or 'an input or a version was another'}); choose another --out to keep both"
    )


def _inputs_of(sweep: Sweep) -> dict[str, str]:
    """Return what decides the sweep's runs, each with a digest or version, to tell later what has changed."""
    found = {name: digest for job in sweep.jobs() for name, digest in job.inputs.items()}
    return base_of(sweep) | found | {"numpy": str(provenance.versions()["numpy"])}


def base_of(sweep: Sweep) -> dict[str, str]:
    """Return the digest of the file of the base scenario, by what it is; {} if that is built in."""
    base = Path(sweep.file.base)
    return {f"base scenario {base}": inputs.digest(base.read_bytes())} if base.is_file() else {}


def _plan(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return the entries of a manifest that determine a sweep's runs, by dotted names as in its file."""
    settings = {name: manifest.get(name) for name in ("seed", "series_every_s", "axes", "paired", "variants")}
    others = {name: manifest.get(name) for name in ("base", "scenario", "sensitivity") if name in manifest}
    return dict(flattened(others | {"sweep": settings}))


def _proofs(table: pd.DataFrame, differing: Sequence[str]) -> dict[str, int]:
    checked_runs = 0 if table.empty else len(table.dropna(subset=list(tables.DIGESTS.values())))
    return {"checked": checked_runs, "equal": checked_runs - len(differing)}
