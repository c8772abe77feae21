"""The tables of a sweep: a row per run, a row per run and window of time, and what the runs cost."""

import hashlib
import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import orjson
import pandas as pd

from deltaswarm_orchestrator.sweeps.folder import SweepFolder
from deltaswarm_orchestrator.sweeps.plan import Job, Sweep
from deltaswarm_orchestrator.sweeps.work import IN_PROCESS, PROCESSES, Result
from deltaswarm_wire.files import write_whole

Finished = list[tuple[Job, Result]]

DIGESTS = {IN_PROCESS: "digest_in_process", PROCESSES: "digest_processes"}
"""The same run by other means must have the same digest: both stand in the table."""


ORIGIN = ("code", "commit")
"""Which version of deltaswarm did a run: a digest of its sources, and the git commit where there is one."""

PER_SENDER = ("operator.per_sender.", "rejected_by_agent.", "excess_by_agent.", "late_acts_by_agent.", "boards.")
"""What a summary has for each sender stands in a table of its own, so that `table.csv` always has the same columns."""


def finished_runs(sweep: Sweep, folder: SweepFolder) -> Finished:
    """The finished runs by variant, then by replicate, by whichever means they were done."""
    order = {variant.label: index for index, variant in enumerate(sweep.variants)}
    jobs = sorted(sweep.jobs(), key=lambda job: (order[job.variant.label], job.replicate))
    found = ((job, folder.result(job, IN_PROCESS) or folder.result(job, PROCESSES)) for job in jobs)
    return [(job, result) for job, result in found if result is not None]


def table_of(runs: Finished, folder: SweepFolder) -> pd.DataFrame:
    """A row per run: variant, swept keys, replicate, seed, digests, every metric of its summary."""
    rows = []
    for job, result in runs:
        digests = {column: _digest(folder.result(job, means)) for means, column in DIGESTS.items()}
        origin = {name: result.get(name) for name in ORIGIN}
        whole = {name: value for name, value in flattened(result["summary"]) if not name.startswith(PER_SENDER)}
        rows.append({**_head(job), **origin, **digests, **whole})
    return pd.DataFrame(rows)


def senders_of(runs: Finished) -> pd.DataFrame:
    """A row per run, sender and count that the summary keeps for each sender: `sender`, `name`, `value`."""
    rows = [
        {**_head(job), "sender": int(sender), "name": ".".join([prefix[:-1], *rest]), "value": value}
        for job, result in runs
        for name, value in flattened(result["summary"])
        if (prefix := next((one for one in PER_SENDER if name.startswith(one)), None))
        for sender, *rest in [name.removeprefix(prefix).split(".")]
    ]
    return pd.DataFrame(rows)


def _head(job: Job) -> dict[str, Any]:
    """What tells a run apart."""
    keys = {name: _cell(value) for name, value in job.variant.keys.items()}
    return {"variant": job.variant.label, **keys, "replicate": job.replicate, "seed": job.scenario.seed}


def _digest(result: Result | None) -> str | None:
    return None if result is None else str(result["summary"]["digest"])


def flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names; lists as JSON."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from flattened(value, f"{prefix}{name}.")
        elif f"{prefix}{name}" not in ("name", "seed"):  # stand in the row's head
            yield f"{prefix}{name}", _cell(value)


def _cell(value: Any) -> Any:
    return orjson.dumps(value).decode() if isinstance(value, list | dict) else value


def series_of(runs: Finished) -> pd.DataFrame:
    """A row per run and window: what tells the run apart, `time_s`, and the window's means."""
    # As floats: a column of a run in which nothing is known would else be one of objects.
    frames = [
        pd.DataFrame(result["series"], dtype=float).assign(**_head(job))[[*_head(job), *result["series"]]]
        for job, result in runs
        if result["series"]
    ]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def costs_of(runs: Finished) -> pd.DataFrame:
    """A row per run: wall time [s], steps per second, largest memory of its process so far [MB], host."""
    return pd.DataFrame([{**_head(job), **result["cost"]} for job, result in runs])


def digest_of(runs: Finished) -> str:
    """One digest for a sweep, over those of its runs in the table's order."""
    found = hashlib.blake2b(digest_size=16)
    for job, result in runs:
        found.update(f"{job.variant.label}/{job.replicate}/{result['summary']['digest']}\n".encode())
    return found.hexdigest()


def differing(table: pd.DataFrame) -> list[str]:
    """Runs whose digests by different means differ: there must be none."""
    if table.empty:
        return []
    both = table.dropna(subset=list(DIGESTS.values()))
    wrong = both[both[DIGESTS[IN_PROCESS]] != both[DIGESTS[PROCESSES]]]
    return [f"{row['variant']}, replicate {row['replicate']}" for _, row in wrong.iterrows()]


def read_table(file: Path, labels: Sequence[str] = ("variant",)) -> pd.DataFrame:
    """Read a table that `write_table` wrote; in these columns `10`, `true` and `None` are text.

    Raises:
        OSError: the file cannot be read.
        ValueError: it holds no table.
    """
    columns = pd.read_csv(file, nrows=0).columns
    texts = {name: str for name in labels if name in columns}
    missing = {name: [""] for name in columns if name not in texts}
    return pd.read_csv(file, dtype=texts, keep_default_na=False, na_values=missing)


def read_series(file: Path) -> pd.DataFrame:
    """The time series of a sweep; empty if it kept none."""
    try:
        return read_table(file)
    except (FileNotFoundError, pd.errors.EmptyDataError):
        return pd.DataFrame()


def write_table(path: Path, table: pd.DataFrame) -> list[Path]:
    """A table as CSV, and as Parquet where pyarrow is installed; each file whole or not at all."""
    written = [path.with_suffix(".csv")]
    write_whole(written[0], table.to_csv(index=False).encode())
    if importlib.util.find_spec("pyarrow") is not None:
        written.append(path.with_suffix(".parquet"))
        write_whole(written[1], table.to_parquet(index=False))
    return written
