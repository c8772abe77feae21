"""`deltaswarm sweep`, and what other commands that do many runs have of it."""

import argparse
import json
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from deltaswarm_orchestrator.exits import FAILED, OK, USAGE, complain

if TYPE_CHECKING:
    from deltaswarm_orchestrator.sweeps.conduct import SweepResult
    from deltaswarm_orchestrator.sweeps.engine import Engine
    from deltaswarm_orchestrator.sweeps.plan import Sweep

ENGINES = ("local", "dask")


def add(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm sweep`."""
    from deltaswarm_orchestrator.sweeps.load import BUILT_IN

    command.add_argument("sweep", metavar="FILE|NAME", help=f"TOML file or {', '.join(BUILT_IN)}")
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a scenario key, for all runs")
    command.add_argument("--repeats", type=int, metavar="N", help="replicates of each variant")
    command.add_argument("--seed", type=int, help="seed from which the replicates' seeds are derived")
    command.add_argument(
        "--prove", type=int, metavar="N", help="runs to repeat with real processes, to compare digests"
    )
    command.add_argument("--series", action="store_true", help="write series.csv, a row per run and window of time")
    command.add_argument("--dry-run", action="store_true", help="check the sweep and list its variants only")
    add_engine(command)
    command.add_argument("--out", type=Path, metavar="FOLDER", help="the sweep folder (default: sweeps/NAME)")
    command.add_argument("--json", action="store_true", help="print the result as JSON")
    command.set_defaults(func=sweep)


def add_engine(command: argparse.ArgumentParser) -> None:
    """Where and by what means runs are done."""
    command.add_argument("-j", "--jobs", type=int, metavar="N", help="runs in parallel (default: number of cores)")
    command.add_argument("--processes", action="store_true", help="every run with real agent processes")
    command.add_argument("--engine", choices=ENGINES, default="local", help="this machine, or a Dask cluster")
    command.add_argument(
        "--scheduler", metavar="ADDRESS", help="with --engine dask: address of the scheduler (default: a local cluster)"
    )


def sweep(arguments: argparse.Namespace) -> int:
    """`deltaswarm sweep`."""
    from deltaswarm_orchestrator.sweeps.load import load_sweep

    settings = {"repeats": arguments.repeats, "seed": arguments.seed, "prove": arguments.prove}
    loaded = load_sweep(arguments.sweep, arguments.set, settings)
    if arguments.dry_run:
        jobs = loaded.jobs()
        print(
            f"{loaded.name}: {len(loaded.variants)} variants x {loaded.file.sweep.repeats} replicates, {len(jobs)} runs"
        )
        print("\n".join(variant.label for variant in loaded.variants))
        return OK
    if arguments.series and not loaded.file.sweep.series_every_s:
        complain("--series: sweep.series_every_s is 0, which keeps no time series")
        return USAGE
    folder = arguments.out or Path("sweeps") / loaded.name
    result = conduct_for(arguments, loaded, folder, with_series=arguments.series)
    if result is None:
        return USAGE
    if arguments.json:
        print(json.dumps({"folder": str(folder), **result.manifest, "well": result.is_well}))
    else:
        print(described(result))
    return OK if result.is_well else FAILED


def conduct_for(
    arguments: argparse.Namespace,
    loaded: "Sweep",
    folder: Path,
    *,
    with_series: bool,
    only: Sequence[str] | None = None,
) -> "SweepResult | None":
    """Do a sweep as the command line says, and say what went wrong; None if it could not begin."""
    from deltaswarm_orchestrator.sweeps.conduct import conduct
    from deltaswarm_orchestrator.sweeps.engine import EngineError
    from deltaswarm_orchestrator.sweeps.folder import SweepFolderError
    from deltaswarm_orchestrator.sweeps.progress import SweepDisplay
    from deltaswarm_orchestrator.sweeps.work import IN_PROCESS, PROCESSES

    means = PROCESSES if arguments.processes else IN_PROCESS
    make_engine = engine_maker(arguments, means)
    if make_engine is None:
        return None
    try:
        with SweepDisplay(loaded.name) as display, _interruptible():
            result = conduct(loaded, folder, make_engine, display, means=means, with_series=with_series, only=only)
    except (SweepFolderError, EngineError, OSError) as error:  # OSError: a full disk beneath a table
        complain(str(error))
        return None
    for file in result.damaged:
        complain(f"{file} was damaged: cut off, or changed after it was written; its run was done again")
    for file in result.left_out:
        complain(f"{file} is damaged: cut off, or changed after it was written; it is not in the tables; delete it")
    if len(result.manifest["code"]) > 1:
        versions = len(result.manifest["code"])
        complain(f"{folder} has runs by {versions} versions of the code; another --out would have one")
    for reason in result.failed:
        complain(f"failed: {reason}")
    for name in result.differing:
        complain(f"digests differ between one process and real processes: {name}")
    if _is_outdated(folder / "page.md", result.manifest["digest"]):
        complain(f"{folder / 'page.md'} is of another table; made anew by: deltaswarm report {folder}")
    if result.interrupted:
        complain(f"interrupted with {result.finished} of {result.runs} runs; the same command goes on from there")
    return result


def _is_outdated(report: Path, digest: str | None) -> bool:
    """Whether there is a report, and it is not that of the sweep with this digest; None: one that is not whole."""
    return report.exists() and (digest is None or digest not in report.read_text())


def engine_maker(arguments: argparse.Namespace, means: str) -> "Callable[[], Engine] | None":
    """What makes the engine that the command line asks for; None, with a complaint, if it asks for nonsense."""
    from deltaswarm_orchestrator.sweeps.conduct import default_workers
    from deltaswarm_orchestrator.sweeps.engine import LocalEngine

    workers = arguments.jobs if arguments.jobs is not None else default_workers(means)
    if workers < 1:
        complain(f"--jobs: {workers}; at least 1 is allowed")
        return None
    if arguments.engine == "local":
        if arguments.scheduler:
            complain("--scheduler is for --engine dask")
            return None
        return lambda: LocalEngine(workers)
    try:
        from deltaswarm_orchestrator.sweeps.cluster import DaskEngine
    except ImportError:
        complain("--engine dask needs Dask: pip install 'deltaswarm[cluster]'")
        return None
    return lambda: DaskEngine(arguments.scheduler, workers)


@contextmanager
def _interruptible() -> Iterator[None]:
    """SIGTERM and a closed terminal end a sweep as Ctrl-C does: tables are written, and it can go on later."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    numbers = (signal.SIGTERM, signal.SIGHUP)
    before: dict[signal.Signals, Any] = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def described(result: "SweepResult") -> str:
    """The end of a sweep, for people."""
    manifest, proofs = result.manifest, result.manifest["proofs"]
    sessions = f" over {manifest['sessions']} sessions" if manifest["sessions"] > 1 else ""
    lines = [
        f"{result.finished} of {result.runs} runs in {manifest['wall_s']:.0f} s{sessions}, digest "
        f"{manifest['digest'] or '-'}"
    ]
    if proofs["checked"]:
        lines.append(
            f"{proofs['equal']} of {proofs['checked']} runs that were also done by real processes have the same digest"
        )
    return "\n".join([*lines, str(result.folder / "table.csv")])
