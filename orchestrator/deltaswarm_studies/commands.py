"""The commands `deltaswarm study` and `deltaswarm report`."""

import argparse
import json
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltaswarm_cli.arguments import add_dry_run, add_json, add_quiet, show
from deltaswarm_cli.sweep import add_run_options, check_sweep, conduct_for
from deltaswarm_orchestrator.base.advice import as_given, command_line
from deltaswarm_orchestrator.base.exits import FAILED, INTERRUPTED, MISSED, OK, USAGE, CommandError, complain, notice
from deltaswarm_orchestrator.base.output import print_result
from deltaswarm_orchestrator.base.paths import check_files, check_out, must_exist
from deltaswarm_wire.arguments import whole
from deltaswarm_wire.plugins import as_recorded

if TYPE_CHECKING:
    from deltaswarm_orchestrator.sweeps.plan import Sweep
    from deltaswarm_orchestrator.sweeps.runner import SweepResult
    from deltaswarm_studies.study import Study

RUNS = "runs.csv"
"""The table of a study's runs in its folder."""

EXAMPLES = """\
examples:
  deltaswarm study paper --plan        the planned runs, how long they take, what they could show
  deltaswarm study paper               every number and claim of the paper, from 8430 runs
  deltaswarm study limits --repeats 3  nine limits of the network; three replicates are a look, not a verdict
  deltaswarm study all --plan          what all built-in studies would take
  deltaswarm study my-study.toml       your own question
  deltaswarm study paper --render      make the page again from its tables
  deltaswarm study my-study.toml --freeze              fix what it asks and expects, before its runs
  deltaswarm study my-study.toml --amend "a typo"      record what has changed since, and why
  deltaswarm study paper --check 20    repeat 20 of its runs, and compare them with their rows in the tables
"""


def add_study(command: argparse.ArgumentParser) -> None:
    """Answer a question: runs, tests, verdicts and figures on one page."""
    command.description = "Answer a question: do the runs of a study file, test its claims, write a page with figures."
    command.epilog, command.formatter_class = EXAMPLES, argparse.RawDescriptionHelpFormatter
    command.add_argument("study", metavar="NAME|FILE", help="a built-in study (`deltaswarm list`) or a TOML file")
    instead = command.add_mutually_exclusive_group()
    instead.add_argument(
        "--plan", action="store_true", help="print the planned runs, their duration, what they could show"
    )
    instead.add_argument("--render", action="store_true", help="run nothing: make the page from the study's tables")
    instead.add_argument(
        "--check",
        nargs="?",
        const=1,
        type=_rows,
        metavar="N|all",
        help="repeat N rows of runs.csv, at least one with each controller, dynamics, radio model and plug-in, by the "
        "other engine where it can, and compare them (default: as few as that takes)",
    )
    instead.add_argument(
        "--freeze", action="store_true", help="before the first run: write protocol.json with what is run and expected"
    )
    instead.add_argument("--amend", metavar="REASON", help="add what has changed since to protocol.json")
    command.add_argument("--seed", type=int, metavar="S", help="with --check: draws the rows (default: a random one)")
    command.add_argument(
        "--replaces",
        default="",
        metavar="REASON",
        help="with --freeze: replace the protocol in the folder, and keep it with the verdicts on its page",
    )
    command.add_argument(
        "--replaces-at",
        action="append",
        default=[],
        nargs=2,
        metavar=("COMMIT", "REASON"),
        help="with --freeze: replace also the protocol that the folder had at this git commit",
    )
    add_dry_run(instead, "the number of runs")
    command.add_argument(
        "--pilot", type=Path, metavar="FOLDER", help="with --plan: a study's folder with runs.csv (default: --out)"
    )
    add_run_options(command)
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: studies/NAME")
    add_quiet(command)
    add_json(command, "the verdicts")
    command.set_defaults(func=do_studies, makes_files=True)


def _seeded(study: "Study", folder: Path) -> "Study":
    """Return a study with the seeds of its protocol, if it is frozen."""
    from deltaswarm_studies.settings import PROTOCOL

    if not (folder / PROTOCOL).exists():
        return study
    from deltaswarm_studies.protocol import seeded  # needs pandas

    return seeded(study, folder)


def _rows(text: str) -> int:
    """Parse a number of rows, or all."""
    return sys.maxsize if text == "all" else whole(1)(text)


def do_studies(arguments: argparse.Namespace) -> int:
    """Do a study, or each study of a collection."""
    from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, PROCESSES, default_workers
    from deltaswarm_studies.load import COLLECTIONS, OF_A_STUDY, load_study
    from deltaswarm_studies.plan import plan, text

    names = COLLECTIONS.get(arguments.study, [arguments.study])
    settings = {"repeats": arguments.repeats, "prove": arguments.prove}
    studies = [load_study(name, arguments.set, settings) for name in names]
    is_collection = len(studies) > 1
    out: Path = arguments.out or Path("studies") / (arguments.study if is_collection else studies[0].name)
    folders = {study.name: out / study.name if is_collection else out for study in studies}
    studies = [_seeded(study, folders[study.name]) for study in studies]

    def result(rows: list[Any]) -> Any:
        return rows if is_collection else rows[0]

    for folder in (out, arguments.pilot):
        if folder is not None:
            check_files(folder)
    if not (arguments.check or arguments.plan):
        check_out(out)
    if arguments.freeze or arguments.amend is not None:
        return _frozen(arguments, studies, folders)
    if not (arguments.render or arguments.check):
        for study in studies:
            check_out(folders[study.name], among=OF_A_STUDY)
            check_sweep(arguments, study.sweep, folders[study.name] / "sweep")
    if arguments.dry_run:
        sizes = [
            {"study": study.name, "variants": len(study.sweep.variants), "repeats": study.repeats} for study in studies
        ]
        show(arguments, result(sizes), "\n".join(study.sweep.size for study in studies))
        return OK
    if arguments.plan:
        workers = arguments.jobs or default_workers(PROCESSES if arguments.processes else IN_PROCESS)
        plans = [plan(study, arguments.pilot or folders[study.name], workers) for study in studies]
        show(arguments, result(plans), "\n\n".join(map(text, plans)))
        return OK
    if is_collection and (arguments.render or arguments.check):
        lacking = [study.name for study in studies if not (folders[study.name] / RUNS).exists()]
        if lacking:
            complain(f"{out} has no tables of {', '.join(lacking)}")
        studies = [study for study in studies if study.name not in lacking]
    if arguments.check:
        from deltaswarm_studies.checking import told

        checked = [_checked(arguments, study, folders[study.name]) for study in studies]
        show(arguments, result(checked), "\n".join(map(told, checked)))
        return max((MISSED if one["differing"] else OK for one in checked), default=FAILED)
    codes, pages = [], []
    for study in studies:
        try:
            code, page = _done(arguments, study, folders[study.name])
        except CommandError as error:
            complain(str(error))
            codes.append(error.code)
            break
        codes.append(code)
        pages.append(page)
    if is_collection and pages:
        from deltaswarm_studies.page import write_index  # imports Matplotlib, which is slow

        index = write_index(arguments.study, studies, out)
        notice(f"{arguments.study}: {index}")
    if arguments.json:
        print_result(json.dumps(result(pages) if pages else [] if is_collection else None))
    return max(codes, key=(OK, MISSED, FAILED, USAGE, INTERRUPTED).index, default=FAILED)


def _frozen(arguments: argparse.Namespace, studies: "list[Study]", folders: dict[str, Path]) -> int:
    from deltaswarm_studies.conducting import file_of
    from deltaswarm_studies.freezing import amend, freeze
    from deltaswarm_studies.protocol import ProtocolError

    if arguments.set or arguments.repeats is not None:
        raise CommandError("--freeze and --amend must go without --set and --repeats: they take the study as it is")
    files, errors = [], []
    for study in studies:
        file, folder = file_of(study, arguments.study), folders[study.name]
        try:
            if arguments.freeze:
                files.append(freeze(study, folder, file, arguments.replaces, arguments.replaces_at))
            else:
                files.append(amend(study, folder, file, arguments.amend))
        except ProtocolError as error:
            errors.append(str(error))
    if files or arguments.json:
        show(arguments, [str(file) for file in files], "\n".join(map(str, files)))
    if errors:
        raise CommandError("\ndeltaswarm: ".join(errors))
    return OK


def _done(arguments: argparse.Namespace, study: "Study", folder: Path) -> tuple[int, dict[str, Any]]:
    """Do one study; return its exit code, and its page and verdicts."""
    from deltaswarm_studies.conducting import beforehand, concluded, file_of

    def conduct(sweep: "Sweep", runs: Path) -> "SweepResult":
        return conduct_for(arguments, sweep, runs, with_series=bool(sweep.file.sweep.series_every_s))

    if not arguments.render:
        problems, notes = beforehand(study, folder)
        for line in problems:
            complain(line)
        for line in notes:
            notice(line)
    try:
        file = file_of(study, arguments.study)
        done = concluded(study, folder, None if arguments.render else conduct, file)
    except (FileNotFoundError, ValueError) as error:
        raise CommandError(_why(arguments, study, error), FAILED) from None
    evidence = done.evidence
    verdicts = evidence.claims[["claim", "verdict"]].to_dict("records") if len(evidence.claims) else []
    if not arguments.json:
        for _, row in evidence.claims.iterrows():
            print_result(f"{row['verdict']:10} {row['text']}")
        print_result(f"{study.name}: {done.page}")
    if done.unsealed:
        notice(done.unsealed)
    for line in done.complaints():
        complain(line)
    invalid = evidence.invalid.to_dict("records")
    return done.code(), {"study": study.name, "page": str(done.page), "claims": verdicts, "invalid": invalid}


def _checked(arguments: argparse.Namespace, study: "Study", folder: Path) -> dict[str, Any]:
    """Repeat some of a study's runs."""
    from deltaswarm_orchestrator.sweeps.engine import LocalEngine
    from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, RunError, default_workers
    from deltaswarm_studies.checking import check

    seed = secrets.randbelow(10**9) if arguments.seed is None else arguments.seed
    workers = arguments.jobs or default_workers(IN_PROCESS)
    try:
        return check(study, folder, arguments.check, seed, LocalEngine(workers))
    except (FileNotFoundError, ValueError, RunError) as error:
        raise CommandError(_why(arguments, study, error), FAILED) from None


def _why(arguments: argparse.Namespace, study: "Study", error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        make = as_given(arguments, without=("--render", "--check"))
        return f"{study.name}: {error.filename} is not there; to make it: {make}"
    return f"{study.name}: {error}"


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
    from deltaswarm_orchestrator.base import seal
    from deltaswarm_orchestrator.sweeps.folder import SweepFolderError
    from deltaswarm_orchestrator.sweeps.job import PROCESSES
    from deltaswarm_orchestrator.sweeps.load import load_sweep
    from deltaswarm_orchestrator.sweeps.runner import base_of
    from deltaswarm_orchestrator.sweeps.table import read_series, read_table
    from deltaswarm_studies.evidence import Evidence
    from deltaswarm_studies.load import OF_A_STUDY, bare_study
    from deltaswarm_studies.metrics import ID
    from deltaswarm_studies.origin import WITH_THE_RUNS, provenance_of
    from deltaswarm_studies.page import write

    folder: Path = arguments.sweep
    must_exist(folder, "SWEEP", "the folder of a sweep")
    check_out(arguments.out or folder, among=OF_A_STUDY if arguments.out else ())
    try:
        manifest = seal.checked(folder / seal.MANIFEST)
        if "swept" not in manifest:
            reason = f"it holds one run: see {command_line('info', folder)}" if manifest else "it has no manifest.json"
            raise SweepFolderError(f"{folder} must be a sweep's folder, written by `deltaswarm sweep` ({reason})")
        if not (folder / "table.csv").exists():
            means = ["--processes"] if manifest.get("means") == PROCESSES else []
            go_on = command_line("sweep", folder / "sweep.toml", "--out", folder, *means)
            raise SweepFolderError(f"{folder} has no table.csv; to write it: {go_on}")
        with as_recorded():  # a page needs no third-party code
            sweep = load_sweep(str(folder / "sweep.toml"))
            was = manifest.get("inputs", {})
            if any(was.get(name, now) != now for name, now in base_of(sweep).items()):
                raise SweepFolderError(f"{sweep.file.base} must be as it was when {folder} was made; undo the change")
            table, series = read_table(folder / "table.csv", needs=ID), read_series(folder / "series.csv")
            study = bare_study(
                sweep, table, has_series=len(series) > 0, reference=arguments.reference, more=arguments.metric
            )
            evidence = Evidence.of_sweep(study, table, series, manifest.get("invalid", []))
            read = [file.name for file in folder.glob("*.csv") if file.stem in ("table", "series")]
            unsealed = seal.not_sealed(manifest, ["sweep.toml", *read])
            sealed = "" if unsealed else WITH_THE_RUNS
            files = write(study, evidence, provenance_of(study, manifest), arguments.out or folder, sealed)
    except ValueError as error:
        raise CommandError(str(error)) from None
    show(arguments, [str(file) for file in files], str(files[0]))
    if unsealed:
        notice(f"{folder}: not sealed, so nobody can tell whether they were changed: {', '.join(unsealed)}")
    for line in evidence.warnings:
        (complain if line in (*evidence.incomplete, *evidence.undrawn) else notice)(line)
    return FAILED if evidence.incomplete or evidence.undrawn else OK
