"""The command `deltaswarm sweep`, and the functions it shares with other commands that do many runs."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_cli.arguments import add_dry_run, add_engine, add_json, add_quiet, show
from deltaswarm_orchestrator.base.advice import as_given
from deltaswarm_orchestrator.base.exits import OK, CommandError, complain, notice
from deltaswarm_orchestrator.processes.elsewhere import IN_ONE_PROCESS
from deltaswarm_wire.arguments import whole

if TYPE_CHECKING:
    from deltaswarm_orchestrator.sweeps.plan import Sweep
    from deltaswarm_orchestrator.sweeps.runner import SweepResult


def add_sweep(command: argparse.ArgumentParser) -> None:
    command.add_argument("sweep", metavar="NAME|FILE", help="a built-in sweep (`deltaswarm list`) or a TOML file")
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
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a scenario key, for all runs")
    command.add_argument(
        "--repeats", type=int, metavar="N", help="replicates of each variant; of a sensitivity sweep, points"
    )
    command.add_argument("--prove", type=int, metavar="N", help="runs to repeat with real processes")
    command.add_argument("-j", "--jobs", type=whole(1), metavar="N", help="runs in parallel (default: number of cores)")
    command.add_argument("--processes", action="store_true", help="every run with real agent processes")
    add_engine(command, "address of the scheduler (default: a local cluster)")


def sweep(arguments: argparse.Namespace) -> int:
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
    if loaded.points:
        notice("points of a sensitivity sweep are judged by `deltaswarm study`, by claims; `deltaswarm report` cannot")
    result = conduct_for(arguments, loaded, folder, with_series=arguments.series, with_events=arguments.events)
    show(arguments, {"folder": str(folder), **result.manifest, "well": result.is_well}, described(result))
    if result.invalid:
        from deltaswarm_orchestrator.sweeps.table import invalid_line  # needs pandas

        complain(invalid_line(result.invalid, result.runs))
    return result.code


def check_sweep(arguments: argparse.Namespace, loaded: "Sweep", folder: Path) -> None:
    """Make every check of a sweep before anything is started or written."""
    from deltaswarm import sweeps

    means = _means(arguments)
    sweeps.engine_maker(arguments.engine, arguments.scheduler, arguments.jobs, means)
    sweeps.check(loaded, folder, means, _asked(arguments))


def conduct_for(
    arguments: argparse.Namespace, loaded: "Sweep", folder: Path, *, with_series: bool, with_events: bool = False
) -> "SweepResult":
    """Do a sweep as the command line says, and print what went wrong on standard error."""
    from deltaswarm import sweeps

    means = _means(arguments)
    make_engine = sweeps.engine_maker(arguments.engine, arguments.scheduler, arguments.jobs, means)
    result = sweeps.conduct(
        loaded,
        folder,
        make_engine,
        means=means,
        asked=_asked(arguments),
        quiet=arguments.quiet,
        with_series=with_series,
        with_events=with_events,
    )
    for line in sweeps.complaints(result, as_given(arguments)):
        complain(line)
    return result


def _asked(arguments: argparse.Namespace) -> str:
    return arguments.engine if arguments.engine in IN_ONE_PROCESS else ""


def _means(arguments: argparse.Namespace) -> str:
    from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES

    return PROCESSES if arguments.processes else IN_PROCESS


def described(result: "SweepResult") -> str:
    manifest, proofs = result.manifest, result.manifest["proofs"]
    return "\n".join(
        [
            f"{result.finished} of {result.runs} runs in {manifest['wall_s']:.0f} s "
            f"(sessions: {manifest['sessions']}), digest {manifest['digest'] or '-'}",
            f"repeated with real processes: {proofs['checked']}, with the same digest: {proofs['equal']}",
            str(result.folder / "table.csv"),
        ]
    )
