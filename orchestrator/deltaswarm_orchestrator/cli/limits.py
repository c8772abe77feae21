"""The command that limits communication: `deltaswarm limits`."""

import argparse
import difflib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deltaswarm_orchestrator.cli.reports import write_report
from deltaswarm_orchestrator.cli.sweep import add_engine, conduct_for
from deltaswarm_orchestrator.exits import FAILED, MISSED, OK, USAGE, complain

if TYPE_CHECKING:
    from deltaswarm_orchestrator.analysis.report import Report
    from deltaswarm_orchestrator.limits.experiments import Experiment
    from deltaswarm_orchestrator.limits.findings import Done, Findings

QUICK_REPEATS = 3


def add(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm limits`."""
    from deltaswarm_orchestrator.limits.experiments import EXPERIMENTS

    command.description = "Limits the network one way at a time, and writes which mode suffers most from what."
    command.add_argument(
        "experiment", nargs="*", metavar="EXPERIMENT", help=f"of {', '.join(EXPERIMENTS)}; all if none"
    )
    command.add_argument("--quick", action="store_true", help=f"{QUICK_REPEATS} replicates: a look, not a verdict")
    command.add_argument("--repeats", type=int, metavar="N", help="replicates of each variant")
    command.add_argument("--prove", type=int, metavar="N", help="runs that real processes do too, to compare digests")
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a scenario key, for all runs")
    add_engine(command)
    command.add_argument("--out", type=Path, default=Path("limits"), metavar="FOLDER", help="default: limits")
    command.add_argument(
        "--page", type=Path, metavar="FILE.md", help="also write the page there, its figures and tables beside it"
    )
    command.add_argument("--json", action="store_true", help="print the files and the answer as JSON")
    command.set_defaults(func=limits)


def limits(arguments: argparse.Namespace) -> int:
    """`deltaswarm limits`."""
    from deltaswarm_orchestrator.limits.answers import answer, loss_bar, loss_bar_in_words
    from deltaswarm_orchestrator.limits.experiments import EXPERIMENTS
    from deltaswarm_orchestrator.limits.findings import Findings, findings_of
    from deltaswarm_orchestrator.limits.page import limits_page
    from deltaswarm_orchestrator.limits.sentences import too_few

    if not _are_known(arguments.experiment, list(EXPERIMENTS)):
        return USAGE
    if arguments.page is not None and arguments.page.suffix != ".md":
        complain(f"--page: {arguments.page}; a name that ends in .md is expected")
        return USAGE
    out: Path = arguments.out
    done = []
    for name, experiment in EXPERIMENTS.items():
        if name in arguments.experiment or not arguments.experiment:
            finished = _done(arguments, experiment, out)
            if isinstance(finished, int):
                return finished
            done.append(finished)
    try:
        findings_of(done).save(out)
        found = Findings.load(out)  # so the page says what the tables say
        report = limits_page(found)
        files = write_report(report, out)
        if arguments.page is not None:
            files += _publish(arguments.page, found, report)
    except OSError as error:
        complain(str(error))
        return FAILED
    said, doubts = [*answer(found), *loss_bar_in_words(found)], too_few(found)
    if arguments.json:
        print(json.dumps({"folder": str(out), "doubts": doubts, "answer": said, "files": [*map(str, files)]}))
    else:
        print("\n".join([*doubts, *said, *map(str, files)]))
    bar = loss_bar(found)
    if bar is None or bar.holds or arguments.quick:
        return OK
    complain("hybrid 3 does not bear the loss that it shall bear")
    return MISSED


def _are_known(names: Sequence[str], known: Sequence[str]) -> bool:
    """Whether all names are experiments'; complains of those that are not."""
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            meant = f"; did you mean {close[0]!r}?" if close else f"; there are {', '.join(known)}"
            complain(f"no experiment is called {name!r}{meant}")
    return set(names) <= set(known)


def _done(arguments: argparse.Namespace, experiment: "Experiment", out: Path) -> "Done | int":
    """An experiment's sweep, done as far as it was not; or an exit code."""
    from deltaswarm_orchestrator.limits.findings import Done
    from deltaswarm_orchestrator.limits.shared import take_over
    from deltaswarm_orchestrator.sweeps.folder import SweepFolderError
    from deltaswarm_orchestrator.sweeps.load import load_sweep

    repeats = arguments.repeats if arguments.repeats is not None else QUICK_REPEATS if arguments.quick else None
    sweep = load_sweep(experiment.name, arguments.set, {"repeats": repeats, "prove": arguments.prove})
    folder = out / experiment.name
    if not arguments.processes:
        try:
            taken = take_over(sweep, folder, sorted(file.parent for file in out.glob("*/runs")))
        except SweepFolderError as error:
            complain(str(error))
            return USAGE
        if taken:
            complain(f"{experiment.name}: {taken} runs are those of other experiments")
    result = conduct_for(arguments, sweep, folder, with_series=True)
    if result is None:
        return USAGE
    if not result.is_well:
        return FAILED
    step_s = sweep.variants[0].scenario.run.step_s
    return Done(experiment, result.manifest, result.table, result.series, step_s)


def _publish(page: Path, found: "Findings", report: "Report") -> list[Path]:
    """The page as Markdown; its figures as PNG and its tables in a folder of its name beside it."""
    from deltaswarm_orchestrator.analysis.report import save_pictures, to_markdown
    from deltaswarm_orchestrator.limits.findings import NOT_PUBLISHED

    folder = page.with_suffix("")
    files = found.save(folder, without=NOT_PUBLISHED)
    for file in save_pictures(report, folder / "figures"):
        if file.suffix == ".png":
            files.append(file)
        else:
            file.unlink()  # the HTML page of --out has them as drawings
    page.write_text(to_markdown(report, f"{folder.name}/figures"), encoding="utf-8")
    return [page, *files]
