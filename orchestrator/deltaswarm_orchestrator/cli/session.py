"""The command `deltaswarm session`."""

import argparse
import secrets
import sys
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from dataclasses import replace
from pathlib import Path

from deltaswarm_orchestrator.base.exits import OK, CommandError, complain, notice
from deltaswarm_orchestrator.base.signals import heed_signals_again
from deltaswarm_orchestrator.cli import run as cli_run
from deltaswarm_orchestrator.cli.arguments import (
    add_dry_run,
    add_json,
    add_markers,
    add_quiet,
    free_folder,
    host_and_port,
    show,
    whole,
)
from deltaswarm_orchestrator.participants.again import ask_again, unanswered
from deltaswarm_orchestrator.participants.record import (
    RECORD,
    attempt_number,
    read_record,
    record_of,
    summaries,
)
from deltaswarm_orchestrator.participants.session import MAX_PARTICIPANT, PlannedRun, load_session, plan
from deltaswarm_orchestrator.participants.tables import write_tables
from deltaswarm_orchestrator.processes.station import LOOPBACK, Station, free_address
from deltaswarm_orchestrator.recording.names import SCENARIO
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError
from deltaswarm_orchestrator.results.run_tables import write_json
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import LANGUAGES, keys_of, language_at, load_scenario
from deltaswarm_scenario.scenario import Scenario


def add_session(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm session`."""
    command.description = "Do all runs of one participant, one after the other, each with a station: training first."
    command.add_argument("session", metavar="FILE", help="a TOML file with a table [session]")
    what = command.add_mutually_exclusive_group(required=True)
    what.add_argument("--participant", type=whole(1, MAX_PARTICIPANT), metavar="N", help="number, from 1 on")
    what.add_argument(
        "--table", type=Path, metavar="FOLDER", help="write the data of all participants there as tables, and do no run"
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: sessions/NAME")
    command.add_argument(
        "--language",
        metavar="LANGUAGE",
        help=f"in which language the page speaks to this participant: {', '.join(LANGUAGES)}, or a TOML file "
        "(default: session.language)",
    )
    command.add_argument(
        "--station-listen",
        type=host_and_port,
        default=LOOPBACK,
        metavar="HOST:PORT",
        help="where the page is served, without encryption (default: this machine alone, any free port)",
    )
    add_markers(command)
    command.add_argument(
        "--researcher", action="store_true", help="also serve the conductor's page, which shows the truth"
    )
    add_dry_run(command, "the runs, in the order of the file as long as the session has not begun")
    command.add_argument("--plan", action="store_true", help="the same as --dry-run")
    add_quiet(command)
    add_json(command)
    command.set_defaults(func=session)


def session(arguments: argparse.Namespace) -> int:
    """Do the remaining runs of a participant's session, or write the tables of all participants."""
    settings, beside = load_session(arguments.session)
    out: Path = arguments.out or Path("sessions") / Path(arguments.session).stem
    if arguments.table:
        files = write_tables(out, arguments.table)
        show(arguments, [str(file) for file in files], "\n".join(map(str, files)))
        return OK
    participant: int = arguments.participant
    if arguments.language is not None:
        settings = replace(settings, language=language_at(arguments.language, Path()))
    planned = plan(settings, participant, beside)
    folder = out / f"participant-{participant:03}"

    address, token = free_address(arguments.station_listen), secrets.token_urlsafe(24)

    def options_for(run: PlannedRun, *, is_first: bool = True) -> RunOptions:
        station = Station(settings.speed, address, token, arguments.markers or "", opens_browser=is_first)
        return RunOptions(free_folder(folder / run.folder), station=station, researcher=arguments.researcher)

    for run in planned:  # before a participant has done the first
        cli_run.check_run(run.scenario, options_for(run))
    for warning in dict.fromkeys(cli_run.isa_warning(run.scenario, settings.speed) for run in planned):
        if warning:
            notice(warning)
    if arguments.plan or arguments.dry_run:
        has_begun = (folder / RECORD).exists()
        labels = [settings.training.label, *(condition.label for condition in settings.condition)]
        if has_begun:
            labels = [run.label for run in planned]
        lines = [f"{place} {label}" for place, label in enumerate(labels[: None if has_begun else 1])]
        lines += (
            []
            if has_begun
            else [f"then, in an order that is shown once the session has begun: {', '.join(labels[1:])}"]
        )
        show(arguments, labels, "\n".join(lines))
        return OK
    folder.mkdir(parents=True, exist_ok=True)
    try:
        lock = FolderLock(folder)
    except HeldError:
        raise CommandError(f"{folder} must be free: another session of this participant is under way") from None
    try:
        return _do_runs(arguments, folder, planned, options_for)
    finally:
        lock.release()


def _do_runs(
    arguments: argparse.Namespace,
    folder: Path,
    planned: list[PlannedRun],
    options_for: Callable[..., RunOptions],
) -> int:
    """Do the runs that are not complete; keep the record."""
    participant: int = arguments.participant
    _check_design(folder, planned)
    write_json(folder / RECORD, record_of(folder, participant, planned))
    is_first = True
    for run in planned:
        done = [name for name, summary in summaries(folder, run).items() if summary["complete"]]
        if done:
            _ask_again(folder / done[-1], run, options_for)
            write_json(folder / RECORD, record_of(folder, participant, planned))
            continue
        notice(f"run {run.position} of {len(planned) - 1}: {run.label}")
        options, is_first = options_for(run, is_first=is_first), False
        scenario = run.attempt(attempt_number(options.out.name, run))
        with redirect_stdout(sys.stderr) if arguments.json else nullcontext():
            code = cli_run.run_and_report(scenario, options, quiet=arguments.quiet)
        write_json(folder / RECORD, record_of(folder, participant, planned))
        heed_signals_again()
        if code == OK:
            _ask_again(options.out, run, options_for)
            write_json(folder / RECORD, record_of(folder, participant, planned))
        if code != OK:
            language = f" --language {arguments.language}" if arguments.language else ""
            again = f"deltaswarm session {arguments.session} --participant {participant}{language}"
            complain(f"the session stops here; to go on: {again}")
            return code
        for summary in [*summaries(folder, run).values()][-1:]:
            if missing := (summary.get("person") or {}).get("answers_missing"):
                complain(f"answers missing in run {run.position}, {run.label}: {missing}")
    show(arguments, {"folder": str(folder), **record_of(folder, participant, planned)}, str(folder))
    return OK


def _ask_again(folder: Path, run: PlannedRun, options_for: Callable[..., RunOptions]) -> None:
    """Ask for the answers that are missing after a complete run, on the same page."""
    probes = unanswered(folder, run.scenario)
    if probes is None or (station := options_for(run).station) is None:
        return
    asked = ", ".join([*(["NASA-TLX"] if probes.tlx else []), *(form.name for form in probes.form)])
    notice(f"asking again after run {run.position}, {run.label}: {asked}")
    ask_again(folder, run.scenario, probes, station)


def _check_design(folder: Path, planned: list[PlannedRun]) -> None:
    """Refuse to go on with a session whose file has changed: runs of two designs would pass for those of one.

    Raises:
        CommandError: the order of the conditions, or the scenario of a complete run, is another one.
    """
    hint = "undo the change of the session's file, or choose another folder by --out"
    if (folder / RECORD).exists():
        before = [run["condition"] for run in read_record(folder)["runs"]]
        if before != (now := [run.label for run in planned]):
            raise CommandError(f"{folder} must be of the runs {', '.join(now)} (got {', '.join(before)}): {hint}")
    for run in planned:
        for name, summary in summaries(folder, run).items():
            file = folder / name / SCENARIO
            expected = run.attempt(attempt_number(name, run))
            if summary["complete"] and (changed := _changed_keys(expected, load_scenario(str(file)))):
                raise CommandError(f"{file} must be as planned (other values of {', '.join(changed)}): {hint}")


def _changed_keys(planned: Scenario, done: Scenario) -> list[str]:
    plans, values = (
        {path: value for path, _, _, value in keys_of(scenario, "") if "[]" not in path} for scenario in (planned, done)
    )
    return [path for path, value in plans.items() if values[path] != value]
