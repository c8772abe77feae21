"""The command `deltaswarm session`."""

import argparse
import json
import sys
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import OK, complain, notice
from deltaswarm_orchestrator.base.signals import begin_anew
from deltaswarm_orchestrator.cli import run as cli_run
from deltaswarm_orchestrator.cli.arguments import add_dry_run, add_json, add_quiet, show, whole
from deltaswarm_orchestrator.participants.session import MAX_PARTICIPANT, PlannedRun, free_folder, load_session, plan
from deltaswarm_orchestrator.results.run_tables import write_json
from deltaswarm_wire.command_line import Parser

RECORD = "session.json"


def add(command: argparse.ArgumentParser) -> None:
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
    for one in planned:  # before a participant has done the first
        cli_run.prepared(_arguments(one, folder))
    if arguments.plan or arguments.dry_run:
        show(arguments, [one.label for one in planned], "\n".join(f"{n} {one.label}" for n, one in enumerate(planned)))
        return OK
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / RECORD, _record(folder, participant, planned))
    for place, one in enumerate(planned):
        if _done(folder, one):
            continue
        notice(f"run {place} of {len(planned) - 1}: {one.label}")
        with redirect_stdout(sys.stderr) if arguments.json else nullcontext():
            code = cli_run.run(_arguments(one, folder, *(["--quiet"] if arguments.quiet else [])))
        write_json(folder / RECORD, _record(folder, participant, planned))
        begin_anew()
        if code != OK:
            complain(
                f"the session stops here; to go on: deltaswarm session {arguments.session} --participant {participant}"
            )
            return code
    show(arguments, {"folder": str(folder), **_record(folder, participant, planned)}, str(folder))
    return OK


def _arguments(one: PlannedRun, folder: Path, *more: str) -> argparse.Namespace:
    """Return the arguments of `deltaswarm run` for a run, with the name of a new folder."""
    name = free_folder(one.folder, [path.name for path in folder.iterdir()] if folder.exists() else [])
    parser = Parser()
    cli_run.add(parser)
    return parser.parse_args([*one.arguments, "--out", str(folder / name), *more])


def _summaries(folder: Path, one: PlannedRun) -> dict[str, dict[str, Any]]:
    """Return the summaries of all attempts at a run, by folder name."""
    names = [path.name for path in folder.iterdir() if path.name == one.folder or _is_again(path.name, one.folder)]
    files = {name: folder / name / "summary.json" for name in sorted(names)}
    return {name: json.loads(file.read_text()) for name, file in files.items() if file.exists()}


def _is_again(name: str, first: str) -> bool:
    return name.startswith(f"{first}-") and name.removeprefix(f"{first}-").isdecimal()


def _done(folder: Path, one: PlannedRun) -> bool:
    return any(summary["complete"] for summary in _summaries(folder, one).values())


def _record(folder: Path, participant: int, planned: list[PlannedRun]) -> dict[str, Any]:
    """Return the order of the conditions, and the attempts at each."""
    rows = []
    for place, one in enumerate(planned):
        attempts = _summaries(folder, one)
        found = [{"folder": name, "complete": s["complete"], "digest": s["digest"]} for name, s in attempts.items()]
        rows.append({"place": place, "condition": one.label, "attempts": found})
    return {"participant": participant, "runs": rows}
