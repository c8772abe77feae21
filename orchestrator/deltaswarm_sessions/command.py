"""The command `deltaswarm session`."""

import argparse
import secrets
import sys
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError, complain, notice
from deltaswarm_orchestrator.base.signals import heed_signals_again
from deltaswarm_orchestrator.cli import run as cli_run
from deltaswarm_orchestrator.cli.arguments import (
    Group,
    add_dry_run,
    add_json,
    add_markers,
    add_quiet,
    free_folder,
    host_and_port,
    number,
    show,
    whole,
)
from deltaswarm_orchestrator.processes.station import LOOPBACK, Station, free_address
from deltaswarm_orchestrator.recording.names import SCENARIO
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError
from deltaswarm_orchestrator.results.run_tables import write_json
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import LANGUAGES, keys_of, language_at, load_scenario
from deltaswarm_scenario.operator_settings import begun_with
from deltaswarm_scenario.questions import FormSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_sessions import outline
from deltaswarm_sessions.again import ask_again, score_form, show_score, unanswered
from deltaswarm_sessions.record import (
    RECORD,
    Attempt,
    attempts_at,
    outcome_of,
    read_record,
    record_of,
    scenario_of,
)
from deltaswarm_sessions.session import (
    MAX_PARTICIPANT,
    PlannedRun,
    SessionSettings,
    load_session,
    plan,
)
from deltaswarm_sessions.tables import RUNS, write_tables
from deltaswarm_sessions.training import END, NOT_REACHED, OPEN, CriterionSettings
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.plugins import find_controller

QUESTION = ("metric", "conditions", "effect", "power", "alpha", "test")
"""Options of --plan."""


def add_session(command: argparse.ArgumentParser) -> None:
    """Do all runs of one participant, in a balanced order."""
    command.description = "Do all runs of one participant, one after the other, each with a station: training first."
    command.add_argument("session", metavar="FILE", help="a TOML file with a table [session]")
    what = command.add_mutually_exclusive_group(required=True)
    what.add_argument("--participant", type=whole(1, MAX_PARTICIPANT), metavar="N", help="number, from 1 on")
    what.add_argument(
        "--table", type=Path, metavar="FOLDER", help="write the data of all participants there as tables, and do no run"
    )
    what.add_argument(
        "--plan",
        type=Path,
        metavar="FOLDER",
        help="print how many participants a study needs, from a pilot's tables there (see --table), and do no run",
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
    add_dry_run(
        command, "the runs, their length and what they ask, in the order of the file while the session has not begun"
    )
    _add_question(command.add_argument_group("with --plan"))
    add_quiet(command)
    add_json(command)
    command.set_defaults(func=session, makes_files=True, handles_signals=True)


def _add_question(group: Group) -> None:
    """Add what a study with the planned number of participants is to show; these options have no effect without it."""
    group.add_argument("--metric", metavar="NAME", help="a column of runs.tsv (default: all that measure something)")
    group.add_argument("--conditions", nargs=2, metavar="LABEL", help="the two to compare, if the session has more")
    group.add_argument(
        "--effect",
        type=number(-1e12, 1e12),
        metavar="N",
        help="difference to find, in the metric's unit (default: the pilot's)",
    )
    group.add_argument("--power", type=number(0.01, 0.99), metavar="N", help="probability of finding it (default: 0.8)")
    group.add_argument("--alpha", type=number(1e-6, 0.5), metavar="N", help="level of the test (default: 0.05)")
    group.add_argument(
        "--test",
        choices=("adjusted", "t", "signed-rank"),
        help="the test of differences: by t and adjusted for position and stream (default), by t, or by signed ranks",
    )


def session(arguments: argparse.Namespace) -> int:
    """Do the remaining runs of a participant's session, write the tables of all participants, or plan their number."""
    settings, beside = load_session(arguments.session)
    asked = {name: value for name in QUESTION if (value := getattr(arguments, name)) is not None}
    if asked and arguments.plan is None:
        raise CommandError(f"--{next(iter(asked))} must be given with --plan, without which it has no effect")
    if arguments.plan is not None:
        return _plan(arguments, settings, asked)
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
        return RunOptions(out=free_folder(folder / run.folder), station=station, researcher=arguments.researcher)

    for run in planned:  # before a participant has done the first
        cli_run.check_run(run.scenario, options_for(run))
    warnings = [*(cli_run.isa_warning(run.scenario, settings.speed) for run in planned), _order_warning(planned)]
    for warning in dict.fromkeys(warnings):
        if warning:
            notice(warning)
    if arguments.dry_run:
        outlined = outline.outline(settings, planned, is_concealed=not (folder / RECORD).exists())
        show(arguments, outlined, outline.text(outlined))
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


def _order_warning(planned: list[PlannedRun]) -> str | None:
    """Return a warning if the page offers an order that sets what the conditions vary; None if it does not."""
    values: dict[tuple[str, str], set[object]] = {}
    for run in planned:
        control = run.scenario.control
        forms = begun_with(forms_of(find_controller(control.mode)), control.options)
        for form in run.scenario.for_operator(forms, 1.0).offered if run.position else ():
            for argument in form.arguments:
                values.setdefault((form.name, argument.name), set()).add(argument.default)
    found = next((names for names, defaults in values.items() if len(defaults) > 1), None)
    return found and (
        f"the conditions vary {found[1]}, which the participant reads and can change in the order {found[0]!r}: "
        'operator.page.orders = ["none"], or a list without it, leaves it out'
    )


def _plan(arguments: argparse.Namespace, settings: SessionSettings, asked: dict[str, Any]) -> int:
    """Print how many participants are needed to find a difference between two conditions."""
    from deltaswarm_sessions.pilot import Question, plan_participants, text  # imports SciPy

    effect = asked.get("effect")
    if effect is not None and ("metric" not in asked or not effect):
        raise CommandError("--effect must be a difference other than 0, given with the --metric in whose unit it is")
    planned = plan_participants(settings, arguments.plan / f"{RUNS}.tsv", Question(**asked))
    if effect is None:
        notice(
            "the effect is the pilot's own, which is uncertain: give the least difference that matters by --effect, "
            "with --metric"
        )
    show(arguments, planned, text(planned))
    return OK


def _do_runs(
    arguments: argparse.Namespace,
    folder: Path,
    planned: list[PlannedRun],
    options_for: Callable[..., RunOptions],
) -> int:
    """Do the runs that are not complete, and training until its criterion is reached; keep the record."""
    participant: int = arguments.participant

    def record() -> None:
        write_json(folder / RECORD, record_of(folder, participant, planned))

    _check_design(folder, planned)
    record()
    is_first = True
    for run in planned:
        for attempt in attempts_at(folder, run):
            if attempt.is_complete:
                _ask_again(folder / attempt.folder, run, attempt.scenario, options_for)
                record()
        while outcome_of(run, earlier := attempts_at(folder, run)) == OPEN:
            notice(f"run {run.position} of {len(planned) - 1}: {run.label}{_repeated(run, earlier)}")
            options, is_first = options_for(run, is_first=is_first), False
            scenario = scenario_of(run, options.out.name, earlier)
            with redirect_stdout(sys.stderr) if arguments.json else nullcontext():
                code = cli_run.run_and_report(scenario, options, quiet=arguments.quiet)
            record()
            heed_signals_again()
            if code != OK:
                language = f" --language {arguments.language}" if arguments.language else ""
                again = f"deltaswarm session {arguments.session} --participant {participant}{language}"
                complain(f"the session stops here; to go on: {again}")
                return code
            ended = attempts_at(folder, run)[-1:]
            _ask_again(options.out, run, scenario, options_for, *(score_form(attempt.summary) for attempt in ended))
            record()
            _complain_of_missing(folder, run)
            if run.criterion is None:
                break
        if _is_ended_by(run, attempts_at(folder, run)):
            return FAILED
    show(arguments, {"folder": str(folder), **record_of(folder, participant, planned)}, str(folder))
    return OK


def _repeated(run: PlannedRun, earlier: list[Attempt]) -> str:
    """Say why training is repeated, and how often; empty: it is not."""
    count = sum(attempt.is_complete for attempt in earlier)
    if run.criterion is None or not count:
        return ""
    return f" again ({count + 1} of at most {run.criterion.max_runs}), since {_judged(run.criterion, earlier)}"


def _judged(criterion: CriterionSettings, attempts: list[Attempt]) -> str:
    values = [criterion.value(attempt.summary) for attempt in attempts if attempt.is_complete]
    got = ", ".join("none" if value is None else f"{value:g}" for value in values)
    return f"{criterion.metric} must be {criterion.bounds} (got {got})"


def _is_ended_by(run: PlannedRun, attempts: list[Attempt]) -> bool:
    """Say if the criterion of a training was not reached; return whether this ends the session."""
    if run.criterion is None or outcome_of(run, attempts) != NOT_REACHED:
        return False
    ends = run.criterion.if_not_reached == END
    then = "the session ends here" if ends else "the session goes on"
    complain(f"the criterion of the training is not reached: {_judged(run.criterion, attempts)}; {then}")
    return ends


def _complain_of_missing(folder: Path, run: PlannedRun) -> None:
    for attempt in attempts_at(folder, run)[-1:]:
        if missing := (attempt.summary.get("person") or {}).get("answers_missing"):
            complain(f"answers missing in run {run.position}, {run.label}: {missing}")


def _ask_again(
    folder: Path,
    run: PlannedRun,
    scenario: Scenario,
    options_for: Callable[..., RunOptions],
    score: FormSettings | None = None,
) -> None:
    """Ask for the answers that are missing after a complete run, on the same page; first show the score, if any."""
    probes = unanswered(folder, scenario)
    station = options_for(run).station
    if station is None or (probes is None and score is None):
        return
    if score is not None:
        show_score(folder, scenario, score, station)
    if probes is None:
        return
    asked = ", ".join([*(["NASA-TLX"] if probes.tlx else []), *(form.name for form in probes.form)])
    notice(f"asking again after run {run.position}, {run.label}: {asked}")
    ask_again(folder, scenario, probes, station)


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
        for attempt in attempts_at(folder, run):
            file = folder / attempt.folder / SCENARIO
            if attempt.is_complete and (changed := _changed_keys(attempt.scenario, load_scenario(str(file)))):
                raise CommandError(f"{file} must be as planned (other values of {', '.join(changed)}): {hint}")


def _changed_keys(planned: Scenario, done: Scenario) -> list[str]:
    plans, values = (
        {path: value for path, _, _, value in keys_of(scenario, "") if "[]" not in path} for scenario in (planned, done)
    )
    return [path for path, value in plans.items() if values[path] != value]
