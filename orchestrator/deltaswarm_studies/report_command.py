"""The command `deltaswarm report`."""

import argparse
from pathlib import Path

from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError, complain, notice
from deltaswarm_orchestrator.cli.arguments import add_json, add_quiet, must_exist, show


def add_report(command: argparse.ArgumentParser) -> None:
    """Write a page about a sweep that has no study."""
    command.description = "Write a page about a sweep: every factor's levels compared, figures, tables."
    command.add_argument("sweep", type=Path, metavar="SWEEP", help="a sweep's folder")
    command.add_argument("--reference", metavar="LEVEL", help="compare the others with this level (default: the first)")
    command.add_argument(
        "--metric", action="append", default=[], metavar="COLUMN", help="a column of table.csv to report as well"
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: the sweep's folder")
    add_quiet(command)
    add_json(command, "the names of the files")
    command.set_defaults(func=report, makes_files=True)


def report(arguments: argparse.Namespace) -> int:
    """Report a sweep without a study, as a study that compares everything."""
    from deltaswarm_orchestrator.sweeps.folder import SweepFolder, SweepFolderError
    from deltaswarm_orchestrator.sweeps.load import load_sweep
    from deltaswarm_orchestrator.sweeps.table import read_series, read_table
    from deltaswarm_studies.evidence import Evidence
    from deltaswarm_studies.load import bare_study
    from deltaswarm_studies.metrics import ID
    from deltaswarm_studies.origin import provenance_of
    from deltaswarm_studies.page import write

    folder: Path = arguments.sweep
    must_exist(folder, "SWEEP", "the folder of a sweep")
    try:
        manifest = SweepFolder(folder).manifest()
        if manifest is None or "swept" not in manifest:
            reason = f"it holds one run: see deltaswarm info {folder}" if manifest else "it has no manifest.json"
            raise SweepFolderError(f"{folder} must be a sweep's folder, written by `deltaswarm sweep` ({reason})")
        if not (folder / "table.csv").exists():
            raise SweepFolderError(f"{folder} has no table.csv; `deltaswarm sweep` continues the sweep and writes it")
        sweep = load_sweep(str(folder / "sweep.toml"))
        table, series = read_table(folder / "table.csv", needs=ID), read_series(folder / "series.csv")
        study = bare_study(
            sweep, table, has_series=len(series) > 0, reference=arguments.reference, more=arguments.metric
        )
        evidence = Evidence.of_sweep(study, table, series)
        files = write(study, evidence, provenance_of(study, manifest), arguments.out or folder)
    except (OSError, ValueError) as error:
        raise CommandError(str(error)) from None
    show(arguments, [str(file) for file in files], str(files[0]))
    for line in evidence.warnings:
        (complain if line in evidence.incomplete else notice)(line)
    return FAILED if evidence.incomplete else OK
