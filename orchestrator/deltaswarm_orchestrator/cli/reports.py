"""The commands that judge and draw: `deltaswarm reproduce` and `deltaswarm report`."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltaswarm_orchestrator.cli.sweep import add_engine, conduct_for
from deltaswarm_orchestrator.exits import FAILED, MISSED, OK, USAGE, complain

if TYPE_CHECKING:
    from deltaswarm_orchestrator.analysis.claims import Judgement
    from deltaswarm_orchestrator.analysis.report import Report

FIGURES = (1, 2, 3, 4, 5)


def add_reproduce(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm reproduce`."""
    extent = command.add_mutually_exclusive_group()
    extent.add_argument("--quick", action="store_true", help="short runs, below 10 minutes on 2 cores (default)")
    extent.add_argument("--full", action="store_true", help="20 replicates of 9000 s of every condition")
    command.add_argument("--figure", type=int, choices=FIGURES, help="only what one of the paper's figures needs")
    add_engine(command)
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: reproduction/quick or reproduction/full")
    command.add_argument("--json", action="store_true", help="print the verdicts as JSON")
    command.set_defaults(func=reproduce)


def add_report(command: argparse.ArgumentParser) -> None:
    """The arguments of `deltaswarm report`."""
    command.add_argument("sweep", type=Path, metavar="SWEEP", help="a sweep's folder")
    command.add_argument("--reference", metavar="VARIANT", help="compared with the others (default: the first)")
    command.add_argument(
        "--figure",
        action="append",
        default=[],
        metavar="COLUMN",
        help="a column of table.csv to report besides the main ones",
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: the sweep's folder")
    command.add_argument("--json", action="store_true", help="print the files written as JSON")
    command.set_defaults(func=report)


def reproduce(arguments: argparse.Namespace) -> int:
    """`deltaswarm reproduce`."""
    import pandas as pd

    from deltaswarm_orchestrator.reproduction import conditions
    from deltaswarm_orchestrator.reproduction.verdict import verdict
    from deltaswarm_orchestrator.sweeps import table as tables
    from deltaswarm_orchestrator.sweeps.load import load_sweep

    extent = conditions.FULL if arguments.full else conditions.QUICK
    folder = arguments.out or Path("reproduction") / extent.name
    only = None if arguments.figure is None else conditions.FIGURES[arguments.figure]
    settings = {"repeats": extent.repeats, "prove": extent.prove}
    sweep = load_sweep("paper", [f"run.duration_s={extent.duration_s}"], settings)
    result = conduct_for(arguments, sweep, folder / "sweep", with_series=True, only=only)
    if result is None:
        return USAGE
    if not result.is_well:
        return FAILED
    found = verdict(result.manifest, extent, arguments.figure, result.table, result.series)
    files = write_report(found.report, folder)
    if found.judgements:
        files += tables.write_table(folder / "claims", pd.DataFrame([tabled(one) for one in found.judgements]))
    if arguments.json:
        print(json.dumps({"folder": str(folder), "claims": [tabled(one) for one in found.judgements]}))
    else:
        print(
            "\n".join(
                f"{judgement.verdict:14} {judgement.claim.name}: {judgement.ours}" for judgement in found.judgements
            )
        )
        print("\n".join(str(file) for file in files))
    for name in found.unexpected:
        complain(f"does not hold, and should: {name}")
    return MISSED if found.unexpected else OK


def report(arguments: argparse.Namespace) -> int:
    """`deltaswarm report`."""
    import pandas as pd

    from deltaswarm_orchestrator.analysis.sweep_report import sweep_report
    from deltaswarm_orchestrator.sweeps.folder import SweepFolder, SweepFolderError

    folder: Path = arguments.sweep
    try:
        manifest = SweepFolder(folder).manifest()
        if manifest is None or "swept" not in manifest:
            found = f"it holds one run: see deltaswarm info {folder}" if manifest else "it has no manifest.json"
            raise SweepFolderError(
                f"{folder} is no sweep's folder ({found}); one that `deltaswarm sweep` wrote is expected"
            )
        if not (folder / "table.csv").exists():
            raise SweepFolderError(
                f"{folder} has no table.csv; `deltaswarm sweep` goes on with the sweep and writes it"
            )
        table = pd.read_csv(folder / "table.csv")
        series = pd.read_csv(folder / "series.csv") if (folder / "series.csv").exists() else None
        made = sweep_report(
            str(folder), manifest, table, series, reference=arguments.reference, figures=arguments.figure
        )
    except (SweepFolderError, OSError, ValueError) as error:
        complain(str(error))
        return USAGE
    files = write_report(made, arguments.out or folder)
    print(json.dumps([str(file) for file in files]) if arguments.json else "\n".join(str(file) for file in files))
    return OK


def write_report(made: "Report", folder: Path) -> list[Path]:
    """The report as one HTML file and as Markdown, its figures beside."""
    from deltaswarm_orchestrator.analysis.report import save_pictures, to_html, to_markdown

    folder.mkdir(parents=True, exist_ok=True)
    html, markdown = folder / "report.html", folder / "report.md"
    html.write_text(to_html(made))
    markdown.write_text(to_markdown(made))
    return [html, markdown, *save_pictures(made, folder / "figures")]


def tabled(judgement: "Judgement") -> dict[str, Any]:
    """A judgement as a row of `claims.csv`."""
    row = {"claim": judgement.claim.name, "where": judgement.claim.source}
    fields = ("verdict", "paper", "ours", "estimate", "low", "high", "in_interval", "p", "p_holm", "effect", "why")
    return row | {name: getattr(judgement, name) for name in fields}
