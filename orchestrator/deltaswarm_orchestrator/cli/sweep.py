"""The command `deltaswarm sweep`, and the functions it shares with other commands that do many runs."""

import argparse
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_orchestrator.base.advice import as_given, command_line
from deltaswarm_orchestrator.base.disk import room_in
from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, OK, CommandError, complain
from deltaswarm_orchestrator.base.paths import check_out
from deltaswarm_orchestrator.cli.arguments import add_dry_run, add_engine, add_json, add_quiet, show, whole
from deltaswarm_orchestrator.processes.engines import engine_of
from deltaswarm_wire.plugin_errors import distinct

if TYPE_CHECKING:
    from deltaswarm_orchestrator.sweeps.engine import Engine
    from deltaswarm_orchestrator.sweeps.plan import Sweep
    from deltaswarm_orchestrator.sweeps.runner import SweepResult


MAX_TOLD = 5
"""Maximum number of failed runs of which each gets a line; the manifest has all."""


def add_sweep(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm sweep`."""
    from deltaswarm_orchestrator.sweeps.load import built_in_files

    command.add_argument("sweep", metavar="FILE|NAME", help=f"TOML file or {', '.join(built_in_files())}")
    command.add_argument("--seed", type=int, help="seed from which the replicates' seeds are derived")
    command.add_argument("--series", action="store_true", help="write series.csv, a row per run and window of time")
    command.add_argument("--events", action="store_true", help="write events.csv, a row per run and event")
    add_dry_run(command, "the variants")
    add_run_options(command)
    command.add_argument("--out", type=Path, metavar="FOLDER", help="the sweep folder (default: sweeps/NAME)")
    add_quiet(command)
    add_json(command)
    command.set_defaults(func=sweep, makes_files=True)


def add_run_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments that say which runs to do, and how."""
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a scenario key, for all runs")
    command.add_argument(
        "--repeats", type=int, metavar="N", help="replicates of each variant; of a sensitivity sweep, points"
    )
    command.add_argument("--prove", type=int, metavar="N", help="runs to repeat with real processes")
    command.add_argument("-j", "--jobs", type=whole(1), metavar="N", help="runs in parallel (default: number of cores)")
    command.add_argument("--processes", action="store_true", help="every run with real agent processes")
    add_engine(command, "address of the scheduler (default: a local cluster)")


def sweep(arguments: argparse.Namespace) -> int:
    """Do a sweep, or list its variants, and print the result."""
    from deltaswarm_orchestrator.sweeps.load import load_sweep

    settings = {"repeats": arguments.repeats, "seed": arguments.seed, "prove": arguments.prove}
    loaded = load_sweep(arguments.sweep, arguments.set, settings)
    if arguments.series and not loaded.file.sweep.series_every_s:
        raise CommandError("--series needs time series, but sweep.series_every_s is 0")
    folder = arguments.out or Path("sweeps") / loaded.name
    check_sweep(arguments, loaded, folder)
    if arguments.dry_run:
        variants = [{"label": variant.label, "keys": variant.keys} for variant in loaded.variants]
        plan = {"sweep": loaded.name, "repeats": loaded.file.sweep.repeats, "variants": variants}
        show(arguments, plan, "\n".join([loaded.size, *(variant.label for variant in loaded.variants)]))
        return OK
    result = conduct_for(arguments, loaded, folder, with_series=arguments.series, with_events=arguments.events)
    show(arguments, {"folder": str(folder), **result.manifest, "well": result.is_well}, described(result))
    if result.invalid:
        from deltaswarm_orchestrator.sweeps.table import invalid_line  # needs pandas

        complain(invalid_line(result.invalid, result.runs))
    return exit_code_of(result)


def check_sweep(arguments: argparse.Namespace, loaded: "Sweep", folder: Path) -> None:
    """Make every check of a sweep before anything is started or written.

    Raises:
        CommandError: the sweep would be refused.
    """
    from deltaswarm_orchestrator.doctor import check_parts_can_start
    from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES

    means = PROCESSES if arguments.processes else IN_PROCESS
    check_out(folder)
    engine_maker(arguments, means)
    if arguments.processes:
        check_parts_can_start(max(variant.scenario.agents.count for variant in loaded.variants))
    if os.path.exists(folder):  # unlike `Path.exists`, False for an impossible name
        from deltaswarm_orchestrator.sweeps.runner import check_folder  # needs pandas

        check_folder(loaded, folder, means)


def conduct_for(
    arguments: argparse.Namespace, loaded: "Sweep", folder: Path, *, with_series: bool, with_events: bool = False
) -> "SweepResult":
    """Do a sweep as the command line says, and print what went wrong on standard error.

    Raises:
        CommandError: the sweep could not start, or its tables could not be written.
    """
    from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES
    from deltaswarm_orchestrator.sweeps.runner import SweepDisplay, SweepReporter, run_sweep

    means = PROCESSES if arguments.processes else IN_PROCESS
    make_engine = engine_maker(arguments, means)
    try:
        with (
            room_in(folder),
            nullcontext(SweepReporter()) if arguments.quiet else SweepDisplay(loaded.name) as display,
        ):
            wanted = {"with_series": with_series, "with_events": with_events}
            result = run_sweep(loaded, folder, make_engine, display, means=means, **wanted)
    except OSError as error:  # such as a table that may not be replaced
        raise CommandError(str(error), FAILED) from None
    complaints = [
        *(f"{file} was damaged: cut off, or changed after it was written; it is not used" for file in result.damaged),
        *(f"failed: {reason}" for reason in each_trace_once(result.failed[:MAX_TOLD])),
        *(f"digests differ between one process and real processes: {name}" for name in result.differing),
    ]
    if (versions := len(result.manifest["code"])) > 1:
        complaints.append(f"{folder} has runs by {versions} versions of the code; another --out would have one")
    if _is_outdated(folder / "page.md", result.manifest["digest"]):
        update = command_line("report", folder)
        complaints.append(f"{folder / 'page.md'} does not match table.csv; to update it: {update}")
    if result.finished < result.runs:
        how = "interrupted with " if result.interrupted else ""
        complaints.append(f"{how}{result.finished} of {result.runs} runs; to go on: {as_given(arguments)}")
    for line in complaints:
        complain(line)
    return result


def exit_code_of(result: "SweepResult") -> int:
    """Return the exit code that tells how a sweep ended."""
    return OK if result.is_well else INTERRUPTED if result.interrupted else FAILED


def _is_outdated(report: Path, digest: str | None) -> bool:
    """Return whether there is a report that is not of the sweep with this digest (None: the sweep is incomplete)."""
    return report.exists() and (digest is None or digest not in report.read_text(encoding="utf-8"))


def engine_maker(arguments: argparse.Namespace, means: str) -> "Callable[[], Engine]":
    """Return a function that makes the engine that the command line asks for.

    Raises:
        CommandError: --scheduler is given for the wrong engine, or Dask is not installed.
    """
    from deltaswarm_orchestrator.sweeps.engine import LocalEngine
    from deltaswarm_orchestrator.sweeps.job import default_workers

    workers = arguments.jobs or default_workers(means)
    if engine := engine_of(arguments.engine, arguments.scheduler):
        return lambda: engine.sweep_engine(workers)
    if arguments.scheduler:
        raise CommandError("--scheduler is for --engine dask")
    return lambda: LocalEngine(workers)


def described(result: "SweepResult") -> str:
    """Format the result of a sweep as text."""
    manifest, proofs = result.manifest, result.manifest["proofs"]
    return "\n".join(
        [
            f"{result.finished} of {result.runs} runs in {manifest['wall_s']:.0f} s "
            f"(sessions: {manifest['sessions']}), digest {manifest['digest'] or '-'}",
            f"repeated with real processes: {proofs['checked']}, with the same digest: {proofs['equal']}",
            str(result.folder / "table.csv"),
        ]
    )


def each_trace_once(reasons: Sequence[str]) -> Iterator[str]:
    """Yield what failed; a traceback that was shown for an earlier one is left out."""
    traces = {reason: trace for reason in reasons if (trace := reason.partition("\nTraceback ")[2])}
    first = {whose[0] for whose in distinct(traces).values()}
    for reason in reasons:
        yield reason.partition("\nTraceback ")[0] if reason in traces.keys() - first else reason
