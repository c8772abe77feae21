"""Do one run of a sweep; return the result that the sweep keeps."""

import math
import os
import platform
import resource
import signal
import subprocess
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import OK, USAGE
from deltaswarm_orchestrator.base.kernel import bound_to_this
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.metric import COUNT, PER_EVENT
from deltaswarm_orchestrator.results.metrics import METRICS
from deltaswarm_orchestrator.results.outcome import EventLife, Outcome, RunData, time_until
from deltaswarm_orchestrator.results.run_tables import OPERATOR_COLUMNS
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.run.choosing import DoneBy, run_here
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_orchestrator.sweeps.plan import Job
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import COLUMNS
from deltaswarm_wire.plugin_errors import distinct

IN_PROCESS, PROCESSES = "in-process", "processes"

WAKE_EVERY_S = 2.0
"""While a sweep waits for a run, it wakes the run's process this often [s], in case a signal stopped it."""

WALL_CLOCK = ("wall_s", "steps_per_s", "real_time_factor")
"""Summary keys that depend on the machine, not on the swarm; they differ each time."""

PRINTED = ("folder", "exit_reason", "why", "operator_restarts", "resumed")
"""Keys that `deltaswarm run --json` adds to a summary. They are about a folder that is deleted after the run."""


class RunError(Exception):
    """A run of a sweep that failed, or is not valid."""


class DisturbedError(RunError):
    """A run lost a process or waited for one too long. The cause is the machine, not the scenario."""


@dataclass(frozen=True)
class Task:
    """A run, and the means by which it is done."""

    job: Job
    means: str = IN_PROCESS
    scratch: str | None = None
    """Folder for what the processes write during the run; None: the system's temporary folder."""
    engine: str = ""
    """What does the run in one process, one of `elsewhere.IN_ONE_PROCESS`; empty: whichever is chosen."""


Result = dict[str, Any]
"""What is kept of a run: summary, time series, events and cost, as plain values for JSON."""


Look = Callable[[Outcome, Scenario, Mapping[str, Any]], Mapping[str, Any]]
"""Returns more numbers for the summary of a run, by name."""


def nothing_more(outcome: Outcome, scenario: Scenario, summary: Mapping[str, Any]) -> Mapping[str, Any]:
    return {}


def work(task: Task, look: Look = nothing_more) -> Result:
    """Do one run."""
    began = time.monotonic()
    scenario = task.job.scenario
    if task.means == PROCESSES:
        (outcome, summary), by = _by_processes(task), DoneBy(PROCESSES)
    else:
        outcome, by = run_here(scenario, asked=task.engine)
        summary = summarise(outcome, scenario)
    if not summary["valid"]:
        traces = "".join(f"\n{trace}" for trace in distinct(outcome.traces))
        raise RunError(f"not valid: {listed_reasons(summary)}{traces}")
    summary |= look(outcome, scenario, summary)
    return {
        "variant": task.job.variant.label,
        "replicate": task.job.replicate,
        "seed": scenario.seed,
        "means": task.means,
        "engine": by.told,
        "code": provenance.code_digest(),
        "commit": provenance.commit(),
        "summary": {name: value for name, value in summary.items() if name not in WALL_CLOCK + PRINTED},
        "series": series_of(outcome, scenario, task.job.series_every_s),
        "events": events_of(outcome),
        "cost": {
            "wall_s": time.monotonic() - began,
            "steps_per_s": summary["steps_per_s"],
            "max_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            "host": platform.node(),
        },
    }


def _by_processes(task: Task) -> tuple[Outcome, dict[str, Any]]:
    """Do the run by `deltaswarm run`, with a process each for the world, the operator and every agent."""
    with TemporaryFolder(Path(task.scratch) if task.scratch else None) as folder:
        file = folder / "scenario.toml"
        file.write_text(to_toml(task.job.scenario), encoding="utf-8")
        options = ["--record", "off", "--out", str(folder / "run"), "--json"]
        code, printed, errors = _run_awake(bound_to_this("deltaswarm_orchestrator", "run", str(file), *options))
        if code != OK:
            kind = RunError if code == USAGE or _a_controller_failed(printed) else DisturbedError
            raise kind(_not_valid(printed) or f"deltaswarm run {how_ended(code)}:\n{errors}")
        summary = orjson.loads(printed)
        return run_tables.read_outcome(folder / "run"), summary


def listed_reasons(summary: Mapping[str, Any]) -> str:
    return "; ".join(summary["invalid_because"])


def _not_valid(printed: str) -> str:
    """Say why the run with this output of `deltaswarm run --json` is not valid; empty if it does not tell."""
    try:
        return f"not valid: {listed_reasons(orjson.loads(printed))}"
    except (ValueError, LookupError, TypeError):
        return ""


def _a_controller_failed(printed: str) -> bool:
    """Return whether the run with this output lost an agent to its controller, which would fail again."""
    try:
        return any(str(row["cause"]).startswith("controller ") for row in orjson.loads(printed)["agents_failed"])
    except (ValueError, LookupError, TypeError):
        return False


def _run_awake(command: Sequence[str]) -> tuple[int, str, str]:
    """Run a command, wake it if it is stopped, and return its exit code, standard output and standard error."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            while True:
                try:
                    printed, errors = process.communicate(timeout=WAKE_EVERY_S)
                    return process.returncode, printed, errors
                except subprocess.TimeoutExpired:
                    process.send_signal(signal.SIGCONT)
        except BaseException:
            process.kill()
            raise


def how_ended(code: int) -> str:
    return f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"


def series_of(outcome: Outcome, scenario: Scenario, every_s: float) -> dict[str, list[float | None]]:
    """Average every column of `series.csv` over windows of `every_s` seconds; `time_s` is each window's start [s].

    Add the metrics of events that are followed over time, and the number of events that arrived in the window and could
    be followed for the horizon (`events_followed`).
    """
    if every_s == 0:
        return {}
    step_s = scenario.run.step_s
    width = round(every_s / step_s)
    starts = range(0, len(outcome.step_records), width)
    edges_s = [start * step_s for start in starts]
    columns: dict[str, list[float | None]] = {"time_s": [*edges_s]}
    records = outcome.step_records
    names = [*records[0].columns()] if records else [*COLUMNS]
    cells = np.array([record.values() for record in records], dtype=float).reshape(len(records), len(names)).T
    rows = dict(zip(names, np.ascontiguousarray(cells), strict=True))
    for name, column in OPERATOR_COLUMNS.items():
        rows[column] = np.array([getattr(row, name) for row in outcome.workloads], dtype=float)
    for column, values in rows.items():
        if column not in ("step", "time_s"):
            columns[column] = _means(values, width, len(starts))

    def window_of(time_s: float) -> int:
        return bisect_right(edges_s, time_s) - 1

    over_time = [metric.over for metric in METRICS if metric.over]
    for over in sorted((over for over in over_time if over.kind == COUNT), key=attrgetter("column")):
        moments_s = [time_s for event in outcome.lives if (time_s := over.moment(event)) is not None]
        counts = Counter(map(window_of, moments_s))
        columns[over.column] = [float(counts[index]) for index in range(len(starts))]
    windows: list[list[EventLife]] = [[] for _ in starts]
    for event in RunData(outcome, scenario).followed:
        windows[window_of(event.arrived_s)].append(event)
    columns["events_followed"] = [float(len(window)) for window in windows]
    horizon_s = scenario.metrics.horizon_s
    for over in over_time:
        if over.kind == PER_EVENT:
            times_s = ([time_until(event, over.moment, horizon_s) for event in window] for window in windows)
            columns[over.column] = [_mean(np.array(window)) for window in times_s]
    return columns


def events_of(outcome: Outcome) -> dict[str, list[float | None]]:
    lives = outcome.lives
    return {name: [getattr(life, name) for life in lives] for name in EventLife._fields}


def _means(values: "np.ndarray[Any, np.dtype[np.float64]]", width: int, windows: int) -> list[float | None]:
    """Return the mean of each window of `width` values, of which the last may have fewer."""
    whole = len(values) // width
    means: list[float] = values[: whole * width].reshape(whole, width).mean(axis=1).tolist()
    return [
        means[number]
        if number < whole and not math.isnan(means[number])
        else _mean(values[number * width : (number + 1) * width])
        for number in range(windows)
    ]


def _mean(window: "np.ndarray[Any, np.dtype[np.float64]]") -> float | None:
    known = window[~np.isnan(window)]
    return float(known.mean()) if known.size else None


def default_workers(means: str) -> int:
    """Return the number of runs to do at once: one per core, or by processes one per two cores."""
    cores = len(os.sched_getaffinity(0))
    return cores if means == IN_PROCESS else max(1, cores // 2)
