"""The command `deltaswarm session`."""

import argparse
import json
import sys
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import OK, CommandError, complain, notice
from deltaswarm_orchestrator.base.signals import heed_signals_again
from deltaswarm_orchestrator.cli import run as cli_run
from deltaswarm_orchestrator.cli.arguments import add_dry_run, add_json, add_quiet, free_folder, show, whole
from deltaswarm_orchestrator.processes.station import Station
from deltaswarm_orchestrator.recording.names import SCENARIO
from deltaswarm_orchestrator.results.run_tables import write_json
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.run.session import MAX_PARTICIPANT, PlannedRun, load_session, plan
from deltaswarm_orchestrator.scenarios.load import keys_of, load_scenario
from deltaswarm_scenario.scenario import Scenario

RECORD = "session.json"


def add_session(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `deltaswarm session`."""
    command.description = "Do all runs of one participant, one after the other, each with a station: training first."
    command.add_argument("session", metavar="FILE", help="a TOML file with a table [session]")
    command.add_argument(
        "--participant", type=whole(1, MAX_PARTICIPANT), required=True, metavar="N", help="number, from 1 on"
    )
    command.add_argument("--out", type=Path, metavar="FOLDER", help="default: sessions/NAME")
    add_dry_run(command, "the order of the runs")
    command.add_argument("--plan", action="store_true", help="the same as --dry-run")
    add_quiet(command)
    add_json(command)
    command.set_defaults(func=session)


def session(arguments: argparse.Namespace) -> int:
    """Do the remaining runs of a participant's session; complete runs are not repeated."""
    participant: int = arguments.participant
    settings, beside = load_session(arguments.session)
    planned = plan(settings, participant, beside)
    out: Path = arguments.out or Path("sessions") / Path(arguments.session).stem
    folder = out / f"participant-{participant:03}"

    def options_for(run: PlannedRun) -> RunOptions:
        return RunOptions(free_folder(folder / run.folder), station=Station(settings.speed))

    for run in planned:  # before a participant has done the first
        cli_run.check_run(run.scenario, options_for(run))
    if arguments.plan or arguments.dry_run:
        show(arguments, [run.label for run in planned], "\n".join(f"{n} {run.label}" for n, run in enumerate(planned)))
        return OK
    folder.mkdir(parents=True, exist_ok=True)
    _check_design(folder, planned)
    write_json(folder / RECORD, _record(folder, participant, planned))
    for place, run in enumerate(planned):
        if any(summary["complete"] for summary in _summaries(folder, run).values()):
            continue
        notice(f"run {place} of {len(planned) - 1}: {run.label}")
        with redirect_stdout(sys.stderr) if arguments.json else nullcontext():
            code = cli_run.run_and_report(run.scenario, options_for(run), quiet=arguments.quiet)
        write_json(folder / RECORD, _record(folder, participant, planned))
        heed_signals_again()
        if code != OK:
            complain(
                f"the session stops here; to go on: deltaswarm session {arguments.session} --participant {participant}"
            )
            return code
    show(arguments, {"folder": str(folder), **_record(folder, participant, planned)}, str(folder))
    return OK


def _check_design(folder: Path, planned: list[PlannedRun]) -> None:
    """Refuse to go on with a session whose file has changed: runs of two designs would pass for those of one.

    Raises:
        CommandError: the order of the conditions, or the scenario of a complete run, is another one.
    """
    hint = "undo the change of the session's file, or choose another folder by --out"
    if (folder / RECORD).exists():
        before = [run["condition"] for run in json.loads((folder / RECORD).read_text(encoding="utf-8"))["runs"]]
        if before != (now := [run.label for run in planned]):
            raise CommandError(f"{folder} must be of the runs {', '.join(now)} (got {', '.join(before)}): {hint}")
    for run in planned:
        for name, summary in _summaries(folder, run).items():
            file = folder / name / SCENARIO
            if summary["complete"] and (changed := _changed_keys(run.scenario, load_scenario(str(file)))):
                raise CommandError(f"{file} must be as planned (other values of {', '.join(changed)}): {hint}")


def _changed_keys(planned: Scenario, done: Scenario) -> list[str]:
    plans, values = (
        {path: value for path, _, _, value in keys_of(scenario, "") if "[]" not in path} for scenario in (planned, done)
    )
    return [path for path, value in plans.items() if values[path] != value]


def _summaries(folder: Path, run: PlannedRun) -> dict[str, dict[str, Any]]:
    """Return the summaries of all attempts at a run, by folder name; further attempts have a number behind the name."""
    first = f"{run.folder}-"
    names = [path.name for path in folder.iterdir()]
    attempts = [
        name for name in names if name == run.folder or (name.startswith(first) and name[len(first) :].isdecimal())
    ]
    files = {name: folder / name / "summary.json" for name in sorted(attempts)}
    return {name: json.loads(file.read_text(encoding="utf-8")) for name, file in files.items() if file.exists()}


def _record(folder: Path, participant: int, planned: list[PlannedRun]) -> dict[str, Any]:
    """Return the order of the conditions, and the attempts at each."""
    runs = [
        {
            "place": place,
            "condition": run.label,
            "attempts": [
                {"folder": name, "complete": summary["complete"], "digest": summary["digest"]}
                for name, summary in _summaries(folder, run).items()
            ],
        }
        for place, run in enumerate(planned)
    ]
    return {"participant": participant, "runs": runs}
