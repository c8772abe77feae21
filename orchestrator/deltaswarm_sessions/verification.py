"""What `deltaswarm verify` does: compare sessions with a published hash and its plan, and repeat their runs."""

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from deltaswarm_cli.arguments import show
from deltaswarm_orchestrator.base import inputs, seal
from deltaswarm_orchestrator.base.exits import FAILED, OK, CommandError
from deltaswarm_orchestrator.base.frozen import HASH, Entry
from deltaswarm_orchestrator.base.paths import check_files
from deltaswarm_orchestrator.recording import COMMANDS, SCENARIO
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_sessions import roster
from deltaswarm_sessions.codes import owner_of
from deltaswarm_sessions.commitment import code_problems, read, run_problem, settings_of
from deltaswarm_sessions.folder import (
    RECORD,
    attempt_number,
    attempts_of,
    folder_name,
    read_record,
    summary_of,
    unsealed_in,
)
from deltaswarm_sessions.links import Links
from deltaswarm_sessions.plan import places_of, run_folder, seed_of
from deltaswarm_sessions.settings import END, NOT_REACHED, SessionSettings

Row = dict[str, Any]


def verify(arguments: argparse.Namespace) -> int:
    """Print what differs from the plan or is missing, and whether each run repeats; return FAILED if there is any."""
    sessions: Path = arguments.data
    check_files(sessions)
    if not (entry := read(sessions)):
        raise CommandError(
            f"DATA must be a folder of sessions with a {roster.COMMITMENT} (got {sessions}); --freeze writes it"
        )
    folders = sorted(folder for folder in sessions.glob("participant-*") if folder.is_dir())
    problems = [*code_problems(entry), *_absent(sessions, folders)]
    if entry[HASH] != arguments.against.strip().lower():
        file = sessions / roster.COMMITMENT
        problems.insert(0, f"--against must be the hash of {file} (got {arguments.against}, not {entry[HASH]})")
    settings, planned, rows, other = settings_of(entry), 0, list[Row](), set[str]()
    for folder in folders:
        if not (folder / RECORD).exists():
            problems.append(f"{folder.name}: {RECORD} is missing, so nobody can tell what was done; restore it")
            continue
        record = read_record(folder)
        for place in _places(settings, record):
            planned += 1
            rows += _attempts(folder, record, entry, settings, place)
        if wrong := [f"{folder.name}: {problem}" for problem in _of_session(folder, record, entry)]:
            problems += wrong
            other.add(folder.name)
    problems += [f"{row['run']}: {row['problem']}" for row in rows if row["problem"]]
    if not planned:
        problems.append(f"DATA must have at least one session (got none in {sessions})")
    complete = {row["of"] for row in rows if row["complete"] and row["of"].split("/")[0] not in other}
    done = complete - {row["of"] for row in rows if row["problem"]}
    told = {"hash": entry[HASH], "date": entry["date"], "planned": planned, "runs": rows, "problems": problems}
    lines = [
        f"frozen {entry['date']}: {entry[HASH]}",
        f"{len(done)} of {planned} planned runs are complete, as planned, and repeat to their digests",
        *(f"{row['run']}: not complete, and done again" for row in rows if not row["complete"] and not row["problem"]),
        *problems,
    ]
    show(arguments, told, "\n".join(lines))
    return FAILED if problems else OK


def verify_code(arguments: argparse.Namespace) -> int:
    """Print whose completion code it is; return FAILED if it is nobody's or its data have changed."""
    sessions: Path = arguments.data
    check_files(sessions)
    if (owner := owner_of(Links.read(sessions), arguments.code, sessions)) is None:
        show(arguments, {"participant": None}, "a code of nobody in this study")
        return FAILED
    link, state = owner.link, "as they were" if owner.is_intact else "changed since, or not those of the code"
    told = {"participant": link.number, "outside": link.outside, "state": link.state, "is_intact": owner.is_intact}
    show(arguments, told, f"participant {link.number}: {link.state}; the data are {state}")
    return OK if owner.is_intact else FAILED


def _absent(sessions: Path, folders: Iterable[Path]) -> Iterator[str]:
    """Say which participants are no longer there, as far as the roster tells."""
    file = sessions / roster.ROSTER
    if problem := roster.doubt(sessions):
        yield problem
    elif not file.exists():
        yield f"{file} is missing, so nobody can tell who withdrew, or who began and is not there"
    noted = roster.read(sessions)
    if noted.unfinished:
        yield f"a command was interrupted; deltaswarm session FILE {noted.option} finishes it"
    for one in noted.withdrawn:
        yield f"participant {one.participant} withdrew on {one.date}, and no run is left to check ({one.reason})"
    for number in sorted(noted.begun):
        if sessions / folder_name(number) not in folders:
            yield f"participant {number} began, and the folder {folder_name(number)} is missing"


def _of_session(folder: Path, record: dict[str, Any], entry: Entry) -> Iterator[str]:
    """Say what is wrong with a session, whatever its runs are."""
    if (frozen := record.get("frozen", "")) != entry[HASH]:
        yield f"must be begun under the frozen plan (got {frozen or 'a session under none'})"
    if record.get("begun", entry["date"]) < entry["date"]:
        yield f"must be begun after the plan was frozen (got {record['begun']})"
    complete = {one["folder"] for run in record["runs"] for one in run["attempts"] if one["complete"]}
    unsealed = [RECORD] if seal.SEAL not in record else []
    unsealed += [name for name in unsealed_in(folder, record) if name.split("/")[0].partition(".again-")[0] in complete]
    if unsealed:
        yield f"not sealed, so nobody can tell whether they were changed: {', '.join(unsealed)}"


def _places(settings: SessionSettings, record: dict[str, Any]) -> range:
    """Return the places of the runs that were planned: the training only, if the session had to end after it."""
    criterion = settings.training.criterion
    ends = criterion is not None and criterion.if_not_reached == END
    is_over = ends and bool(record["runs"]) and record["runs"][0].get("outcome") == NOT_REACHED
    return range(1 if is_over else len(settings.condition) + 1)


def _attempts(
    folder: Path, record: dict[str, Any], entry: Entry, settings: SessionSettings, place: int
) -> Iterator[Row]:
    """Yield each attempt at a planned run with what is wrong with it; if none is complete and valid, the run itself."""
    condition, _, number = places_of(settings, roster.allocated(record))[place]
    label = condition.label
    nothing: Row = {"place": place, "condition": label, "attempts": []}
    run = next((one for one in record["runs"] if one["place"] == place), nothing)
    first = run_folder(place, run["condition"])
    of = f"{folder.name}/{first}"
    is_done = False
    for name, recorded in attempts_of(folder, run).items():
        attempt = recorded or summary_of(folder / name)
        is_complete, problem = attempt["complete"], ""
        if is_complete and run["condition"] != label:
            problem = f"the condition must be {label}, by the frozen order (got {run['condition']})"
        elif is_complete:
            problem = _problem(folder / name, label, entry, seed_of(settings.seed, number, attempt_number(name, first)))
        is_done |= bool(is_complete and attempt.get("valid", True))
        yield {"run": f"{folder.name}/{name}", "of": of, "complete": is_complete, "problem": problem}
    if not is_done:
        problem = f"planned, and {'not complete' if run['attempts'] else 'not done'}"
        yield {"run": of, "of": of, "complete": False, "problem": problem}


def _problem(run: Path, condition: str, entry: Entry, seed: int) -> str:
    """Say how a run differs from the plan, or that it does not repeat; empty if all is well."""
    if not run.exists():
        return "its folder was deleted"
    started = seal.read_sealed(run / seal.MANIFEST).get("started") or ""
    if started < entry["date"]:
        return f"must be begun after the plan was frozen (got {started or 'no time'})"
    orders = run / COMMANDS
    scenario = load_scenario(str(run / SCENARIO), commands=orders if orders.exists() else None)
    if changed := run_problem(entry, condition, seed, load_scenario(str(run / SCENARIO))):
        return changed
    summary, outcome = summary_of(run), run_in_process(scenario)
    for what, now in (("digest", outcome.digest), ("events_digest", outcome.events_digest)):
        if (was := summary.get(what, now)) != now:  # earlier versions have no digest of events
            because = inputs.why_other(seal.read_sealed(run / seal.MANIFEST), scenario)
            return f"the {what} must repeat (got {now}, not {was}: {because})"
    return ""
