"""Sweeps: many runs that differ in some keys, done from Python or by the command line."""

import math
import os
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltaswarm.arguments import COUNTS, SEEDS, public
from deltaswarm.errors import Error, in_python, one_error
from deltaswarm.keys import MAIN, overrides
from deltaswarm.runs import IN_PROCESS, PROCESSES, Run, UnsavedRun
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.processes.elsewhere import IN_ONE_PROCESS, LOCAL, engine_of
from deltaswarm_wire.foreign import called
from deltaswarm_wire.plugin_errors import PluginError, defined_at, distinct, note_plugin

if TYPE_CHECKING:
    import pandas as pd

    from deltaswarm_orchestrator.sweeps.engine import Engine
    from deltaswarm_orchestrator.sweeps.plan import Sweep
    from deltaswarm_orchestrator.sweeps.runner import SweepResult

MAX_TOLD = 5
"""Maximum number of failed runs of which each gets a line; the manifest has all."""

MakeEngine = Callable[[], "Engine"]


@public(replicates=COUNTS, jobs=COUNTS, seed=SEEDS)
def sweep(
    sweep: str | os.PathLike[str],
    keys: Mapping[Any, Any] | None = None,
    *,
    replicates: int | None = None,
    seed: int | None = None,
    jobs: int | None = None,
    engine: str = IN_PROCESS,
    scheduler: str | None = None,
    metrics: Mapping[str, Callable[[Run], float | None]] | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> "pd.DataFrame":
    """Do the missing runs of a sweep, as `deltaswarm sweep` does it, and return its table: a row per run.

    Columns: `variant`, the swept keys, `replicate`, `seed`, `code`, `commit`, `digest_in_process`, `digest_processes`,
    and the metrics of `summary.json` by dotted names such as `told_s.mean` [s] (docs/RESULTS.md). The folder has more
    tables; `table.attrs["folder"]` is its path.

    Ctrl-C, and runs that fail, leave the others: the table has these, and a warning says what is missing.

    Args:
        sweep: a built-in sweep or study (`deltaswarm list`) or a TOML file.
        keys: scenario keys for all runs, as for `run`. A class of a notebook is taken if this process does all runs.
        replicates: runs of each variant; None: as the file says.
        seed: from which the replicates' seeds are derived; None: the file's.
        jobs: runs in parallel; None: one per core. 1 with a notebook's classes or `metrics`: in this process.
        engine: "in-process", "processes" (a process for each agent), or an engine such as "dask".
        scheduler: with an engine: the address of its scheduler.
        metrics: more columns: functions of a run that return a number. This process does all runs then.
        out: the folder; None: `sweeps/NAME`, or a temporary folder if classes of a notebook or `metrics` are given,
            whose runs nobody could repeat from the files.
        progress: show a bar on a terminal or in a notebook.

    Raises:
        Error: the sweep or its keys have mistakes, the folder holds something else, or pandas is not installed.
    """
    with one_error("deltaswarm.sweep"), TemporaryFolder() as temporary:
        from deltaswarm_orchestrator.sweeps.load import load_sweep

        given = overrides(keys or {})
        is_own = bool(metrics) or any(f"{MAIN}:" in override for override in given)
        if is_own and (engine != IN_PROCESS or jobs not in (None, 1) or out is not None):
            raise Error(
                "metrics, and classes of a notebook, must be used in one process that keeps no runs, as none could be "
                f"repeated: engine={IN_PROCESS!r}, jobs=1 and out=None (got {engine!r}, {jobs} and {out!r})"
            )
        settings = {"repeats": replicates, "seed": seed, "prove": 0 if is_own else None}
        loaded = load_sweep(os.fspath(sweep), given, settings)
        means = PROCESSES if engine == PROCESSES else IN_PROCESS
        folder = Path(temporary if is_own else out or Path("sweeps") / loaded.name)
        local = (IN_PROCESS, PROCESSES)
        make_engine = (
            _in_this_process(metrics or {})
            if is_own
            else engine_maker(engine, scheduler, jobs, means, path="engine", local=local)
        )
        check(loaded, folder, means)
        result = conduct(loaded, folder, make_engine, means=means, quiet=not progress)
        table = result.table
        table.attrs |= {"folder": str(folder), "digest": result.manifest["digest"]}
    if lines := [*complaints(result), *_invalid(result)]:
        warnings.warn(in_python("\n".join(lines)), stacklevel=3)
    return table


def _in_this_process(metrics: Mapping[str, Callable[[Run], float | None]]) -> MakeEngine:
    """Return a maker of an engine that does all runs here, and computes more metrics of each.

    Raises:
        Error: a metric has the name of another one.
    """
    from deltaswarm_orchestrator.results.summary import EVERY_KEY
    from deltaswarm_orchestrator.sweeps.engine import ThisProcess

    if taken := sorted({key.key.partition(".")[0] for key in EVERY_KEY} & set(metrics)):
        raise Error(f"metrics must have names of their own (got {', '.join(taken)})")

    for metric in metrics.values():
        note_plugin(str(getattr(metric, "__module__", "")))

    def look(outcome: Any, scenario: Any, summary: Mapping[str, Any]) -> dict[str, Any]:
        run = UnsavedRun(outcome, scenario, dict(summary))
        return {name: _number(name, metric, run) for name, metric in metrics.items()}

    return lambda: ThisProcess(look)


def _number(name: str, metric: Callable[[Run], Any], run: Run) -> float | None:
    """Return a metric's number for a run; None for None and NaN, the mean of nothing. Raises PluginError."""
    value = called(f"metric {name}", metric, run)
    number = math.inf
    with suppress(TypeError, ValueError):
        number = math.nan if value is None else float(value)
    if math.isinf(number):
        must = f"metric {name} must return a finite number or None (got {value!r:.80})"
        raise PluginError(f"{must} ({defined_at(metric)})")
    return None if math.isnan(number) else number


def _invalid(result: "SweepResult") -> Iterator[str]:
    from deltaswarm_orchestrator.sweeps.table import invalid_line

    if result.invalid:
        yield invalid_line(result.invalid, result.runs)


def check(loaded: "Sweep", folder: Path, means: str, asked: str = "") -> None:
    """Make every check of a sweep before anything is started or written.

    Raises:
        SettingsError, CommandError: the sweep would be refused.
    """
    from deltaswarm_orchestrator.doctor import check_parts_can_start
    from deltaswarm_orchestrator.run.options import check_packages

    check_out(folder)
    for scenario in loaded.scenarios:
        check_packages(scenario)
    if asked:
        from deltaswarm_orchestrator.run.choosing import planned_by

        for scenario in loaded.scenarios:
            planned_by(scenario, asked=asked)
    if means == PROCESSES:
        check_parts_can_start(max(variant.scenario.agents.count for variant in loaded.variants))
    if os.path.exists(folder):  # unlike `Path.exists`, False for an impossible name
        from deltaswarm_orchestrator.sweeps.runner import check_folder  # needs pandas

        check_folder(loaded, folder, means)


def engine_maker(
    name: str,
    scheduler: str | None,
    jobs: int | None,
    means: str,
    *,
    path: str = "--engine",
    local: Collection[str] = (LOCAL, *IN_ONE_PROCESS),
) -> MakeEngine:
    """Return a function that makes the engine of this name for `jobs` runs in parallel.

    `path` says where the name was given, for messages; the names in `local` mean this machine.

    Raises:
        CommandError: there are no jobs, a scheduler is given for the wrong engine, or Dask is not installed.
    """
    from deltaswarm_orchestrator.sweeps.engine import LocalEngine
    from deltaswarm_orchestrator.sweeps.job import default_workers

    if jobs is not None and jobs < 1:
        raise CommandError(f"jobs must be at least 1 (got {jobs})")
    workers = jobs or default_workers(means)
    if engine := engine_of(name, scheduler, path=path, local=local):
        return lambda: engine.sweep_engine(workers)
    return lambda: LocalEngine(workers)


def conduct(
    loaded: "Sweep",
    folder: Path,
    make_engine: MakeEngine,
    *,
    means: str,
    asked: str = "",
    quiet: bool,
    with_series: bool = False,
    with_events: bool = False,
) -> "SweepResult":
    """Do a checked sweep, and show its progress.

    Raises:
        CommandError: the sweep could not start, or its tables could not be written.
    """
    from deltaswarm_orchestrator.sweeps.runner import SweepDisplay, SweepReporter, run_sweep

    wanted = {"with_series": with_series, "with_events": with_events}
    with nullcontext(SweepReporter()) if quiet else SweepDisplay(loaded.name) as display:
        return run_sweep(loaded, folder, make_engine, display, means=means, asked=asked, **wanted)


def complaints(result: "SweepResult", go_on: str = "") -> list[str]:
    """Return what went wrong in a sweep, a line each; `go_on` is the command line that does what is missing."""
    folder = result.folder
    lines = [
        *(f"{file} was damaged: cut off, or changed after it was written; it is not used" for file in result.damaged),
        *(f"failed: {reason}" for reason in each_trace_once(result.failed[:MAX_TOLD])),
        *(f"digests differ between one process and real processes: {name}" for name in result.differing),
    ]
    if (versions := len(result.manifest["code"])) > 1:
        lines.append(f"{folder} has runs by {versions} versions of the code; another --out would have one")
    if _is_outdated(folder / "page.md", result.manifest["digest"]):
        update = command_line("report", folder)
        lines.append(f"{folder / 'page.md'} does not match table.csv; to update it: {update}")
    if result.finished < result.runs:
        how = "interrupted with " if result.interrupted else ""
        lines.append(f"{how}{result.finished} of {result.runs} runs{go_on and f'; to go on: {go_on}'}")
    return lines


def _is_outdated(report: Path, digest: str | None) -> bool:
    """Return whether there is a report that is not of the sweep with this digest (None: the sweep is incomplete)."""
    return report.exists() and (digest is None or digest not in report.read_text(encoding="utf-8"))


def each_trace_once(reasons: Sequence[str]) -> Iterator[str]:
    """Yield what failed; a traceback that was shown for an earlier one is left out."""
    traces = {reason: trace for reason in reasons if (trace := reason.partition("\nTraceback ")[2])}
    first = {whose[0] for whose in distinct(traces).values()}
    for reason in reasons:
        yield reason.partition("\nTraceback ")[0] if reason in traces.keys() - first else reason
