"""The tables of a sweep: results per run, per run and time window, and per sender, and the runs' costs."""

import hashlib
import importlib.util
import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.processes.elsewhere import PYTHON
from deltaswarm_orchestrator.results.outcome import READ, SHOWN, EventLife
from deltaswarm_orchestrator.sweeps.folder import SweepFolder
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES, Result
from deltaswarm_orchestrator.sweeps.plan import Job, Sweep, cell, flattened
from deltaswarm_wire.cells import guarded, raw
from deltaswarm_wire.files import write_whole

Finished = list[tuple[Job, Result]]

InvalidRun = dict[Any, Any]
"""A run that has failed or is not valid, and so is no replicate: `variant`, `replicate`, `means` and `reason`."""

DIGESTS = {IN_PROCESS: "digest_in_process", PROCESSES: "digest_processes"}
"""Digest columns by means. The digests of one run by both means must be equal; the table has both."""

EVENTS_DIGESTS = {means: f"events_{column}" for means, column in DIGESTS.items()}
"""The same of the digests over events; empty in runs of versions that had none."""

MAX_NAMED = 8
"""Maximum number of variants named in a line."""

ORIGIN = ("code", "commit")
"""The version of deltaswarm that did a run: a digest of its sources, and the git commit if there is one."""

OF_PERSON = (SHOWN.column, READ.column)
"""Moments that only runs with a person at the console have."""

PER_SENDER = ("operator.per_sender.", "rejected_by_agent.", "excess_by_agent.", "late_acts_by_agent.", "boards.")
"""Prefixes of a summary's per-sender entries. They have their own table, so that `table.csv` has fixed columns."""


def finished_runs(sweep: Sweep, folder: SweepFolder) -> Finished:
    """Return the finished runs by variant, then replicate; an in-process result is preferred."""
    order = {variant.label: index for index, variant in enumerate(sweep.variants)}
    jobs = sorted(sweep.jobs(), key=lambda job: (order[job.variant.label], job.replicate))
    results = ((job, folder.result(job, IN_PROCESS) or folder.result(job, PROCESSES)) for job in jobs)
    return [(job, result) for job, result in results if result is not None]


def table_of(runs: Finished, folder: SweepFolder) -> pd.DataFrame:
    """Make a row per run: variant, swept keys, replicate, seed, origin, digests, metrics of its summary."""
    rows = []
    for job, result in runs:
        digests: dict[str, str | None] = {}
        for means in DIGESTS:
            kept = folder.result(job, means)
            digests[DIGESTS[means]] = str(kept["summary"]["digest"]) if kept else None
            digests[EVENTS_DIGESTS[means]] = kept["summary"].get("events_digest") if kept else None
        origin = {name: result.get(name) for name in ORIGIN}
        rows.append({**_head(job), **origin, **digests, **metrics_of(result)})
    return pd.DataFrame(rows)


def invalid_run(job: Job, means: str, reason: str) -> InvalidRun:
    """Make the row of a run without a result, with its reason in one line: of a traceback the last one."""
    lines = [line for line in reason.strip().splitlines() if line.strip()] or ["for an unknown reason"]
    line = lines[-1] if lines[0].startswith("Traceback") else lines[0]
    return {"variant": job.variant.label, "replicate": job.replicate, "means": means, "reason": line.strip()}


def invalid_line(invalid: Sequence[InvalidRun], runs: int) -> str:
    """Say how many of the runs are no replicates, which, and why the first of them is none; empty if all are."""
    if not invalid:
        return ""
    replicates: dict[str, set[int]] = {}
    for row in invalid:
        replicates.setdefault(row["variant"], set()).add(row["replicate"])
    named = [f"{label} (replicates {ranges(sorted(numbers))})" for label, numbers in replicates.items()]
    more = f"; and {len(named) - MAX_NAMED} more variants" if len(named) > MAX_NAMED else ""
    first, count = invalid[0], sum(map(len, replicates.values()))
    return (
        f"{count} of {runs} runs failed or are not valid, and are no replicates: {'; '.join(named[:MAX_NAMED])}{more}. "
        f"For example {first['variant']}, replicate {first['replicate']}: {first['reason']}"
    )


def ranges(numbers: Sequence[int]) -> str:
    """Shorten ascending numbers, such as 1, 2, 3, 7 to "1 to 3, 7"."""
    groups = itertools.groupby(enumerate(numbers), key=lambda pair: pair[1] - pair[0])
    runs = [[number for _, number in group] for _, group in groups]
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


def row_of(job: Job, result: Result) -> pd.DataFrame:
    """Make the table's row of one run, without its origin."""
    return pd.DataFrame([{**_head(job), **metrics_of(result)}])


def metrics_of(result: Result) -> dict[str, Any]:
    return {name: value for name, value in flattened(result["summary"]) if not name.startswith(PER_SENDER)}


def senders_of(runs: Finished) -> pd.DataFrame:
    """Make a row (`sender`, `name`, `value`) per run and per-sender entry of its summary."""
    rows = [
        {**_head(job), "sender": int(sender), "name": ".".join([prefix[:-1], *rest]), "value": value}
        for job, result in runs
        for name, value in flattened(result["summary"])
        if (prefix := next(filter(name.startswith, PER_SENDER), None))
        for sender, *rest in [name.removeprefix(prefix).split(".")]
    ]
    return pd.DataFrame(rows)


def _head(job: Job) -> dict[str, Any]:
    keys = {name: cell(value) for name, value in job.variant.keys.items()}
    return {"variant": job.variant.label, **keys, "replicate": job.replicate, "seed": job.scenario.seed}


def series_of(runs: Finished) -> pd.DataFrame:
    """Make a row per run and window: columns that identify the run, `time_s`, and the window's means."""
    # As floats: otherwise a column in which every value is None would get the dtype object.
    frames = [
        pd.DataFrame(result["series"], dtype=float).assign(**_head(job))[[*_head(job), *result["series"]]]
        for job, result in runs
        if result["series"]
    ]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def events_of(runs: Finished) -> pd.DataFrame:
    """Make a row per run and event: columns that identify the run, those of a run's `events.csv`, the run's end [s].

    Runs of earlier versions, which kept no events, have no rows.
    """
    frames = [
        pd.DataFrame(result["events"], dtype=float).assign(**_head(job), end_s=job.scenario.run.duration_s)
        for job, result in runs
        if result.get("events")
    ]
    if not frames:
        return pd.DataFrame()
    events = pd.concat(frames, ignore_index=True).astype({"event": int})
    known = [name for name in EventLife._fields if name not in OF_PERSON or (name in events and events[name].any())]
    return events[[*_head(runs[0][0]), *known, "end_s"]]


def costs_of(runs: Finished) -> pd.DataFrame:
    """Make a row per run: wall time [s], steps per second, peak memory of its process so far [MB], host."""
    return pd.DataFrame([{**_head(job), **result["cost"]} for job, result in runs])


def engines_of(runs: Finished) -> dict[str, int]:
    """Count the runs by the engine that did each; those of earlier versions were done by the Python engine."""
    return dict(Counter(result.get("engine", {"by": PYTHON})["by"] for _, result in runs))


def digest_of(runs: Finished) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for job, result in runs:
        digest.update(f"{job.variant.label}/{job.replicate}/{result['summary']['digest']}\n".encode())
    return digest.hexdigest()


def differing(table: pd.DataFrame) -> list[str]:
    """List the runs whose digests by different means differ; there must be none."""
    if table.empty:
        return []
    is_wrong = pd.Series(False, index=table.index)
    for columns in (DIGESTS, EVENTS_DIGESTS):
        both = table.dropna(subset=list(columns.values()))
        is_wrong |= (both[columns[IN_PROCESS]] != both[columns[PROCESSES]]).reindex(table.index, fill_value=False)
    wrong = table[is_wrong]
    return [f"{row['variant']}, replicate {row['replicate']}" for _, row in wrong.iterrows()]


def read_table(file: Path, labels: Sequence[str] = ("variant",), needs: Sequence[str] = ()) -> pd.DataFrame:
    """Read a table that `write_table` wrote. In the columns `labels`, `10`, `true` and `None` are text."""
    columns = pd.read_csv(file, nrows=0).columns
    if absent := [name for name in needs if name not in columns]:
        raise ValueError(f"{file} must have the columns {', '.join(needs)}; it lacks {', '.join(absent)}")
    texts = {name: str for name in labels if name in columns}
    missing = {name: [""] for name in columns if name not in texts}
    return _with_texts(pd.read_csv(file, dtype=texts, keep_default_na=False, na_values=missing), raw)


def read_series(file: Path) -> pd.DataFrame:
    """Read the time series of a sweep; return an empty frame if it kept none."""
    try:
        return read_table(file)
    except (FileNotFoundError, pd.errors.EmptyDataError):
        return pd.DataFrame()


def _with_texts(table: pd.DataFrame, change: Callable[[Any], Any]) -> pd.DataFrame:
    """Return a table with its texts changed. A column of which none changes keeps its type."""
    texts = table.select_dtypes(exclude=["number", "bool"])
    changed = {str(name): [change(cell) for cell in texts[name]] for name in texts}
    return table.assign(**{name: cells for name, cells in changed.items() if cells != [*texts[name]]})


def write_table(path: Path, table: pd.DataFrame) -> list[Path]:
    """Write a table as CSV, and as Parquet if pyarrow is installed, each atomically; return the files."""
    files = {path.with_suffix(".csv"): _with_texts(table, guarded).to_csv(index=False).encode()}
    if importlib.util.find_spec("pyarrow") is not None:
        files[path.with_suffix(".parquet")] = table.to_parquet(index=False)
    for file, data in files.items():
        write_whole(file, data)
    return list(files)
