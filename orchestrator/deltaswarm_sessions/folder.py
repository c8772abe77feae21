"""A participant's folder: the record `session.json`, the attempts at each run, and all answers given in it or later."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.recording import SCENARIO
from deltaswarm_orchestrator.results.folder import results_in
from deltaswarm_orchestrator.results.run_tables import PROBES, SITUATION, read_rows
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.situation import shares
from deltaswarm_scenario.technique import AFTER
from deltaswarm_scenario.techniques import TECHNIQUES
from deltaswarm_sessions.plan import PlannedRun
from deltaswarm_sessions.session import Attempt, Session, changed_keys

RECORD, SUMMARY = "session.json", "summary.json"

Row = dict[str, str]


def folder_name(participant: int) -> str:
    """Return the name of a participant's folder."""
    return f"participant-{participant:03}"


def check_design(folder: Path, session: Session) -> None:
    """Refuse to go on with a session whose file has changed: runs of two designs would pass for those of one.

    Raises:
        CommandError: the order of the conditions, or the scenario of a valid run, is another one.
    """
    hint = "undo the change of the session's file, or choose another folder by --out"
    if (folder / RECORD).exists():
        before = [run["condition"] for run in read_record(folder)["runs"]]
        if before != (now := [run.label for run in session.runs]):
            raise CommandError(f"{folder} must be of the runs {', '.join(now)} (got {', '.join(before)}): {hint}")
    for attempt in (attempt for attempts in session.attempts.values() for attempt in attempts if attempt.is_valid):
        file = folder / attempt.folder / SCENARIO
        if changed := changed_keys(attempt.scenario, load_scenario(str(file))):
            raise CommandError(f"{file} must be as planned (other values of {', '.join(changed)}): {hint}")


def read_record(folder: Path) -> dict[str, Any]:
    """Return the record in a participant's folder.

    Raises:
        CommandError: it cannot be read, or it, or a file that it seals, has been changed.
    """
    record = _having(folder / RECORD, seal.checked(folder / RECORD), "runs")
    if folder.name != folder_name(record["participant"]):
        raise CommandError(f"{folder / RECORD} must be of this participant (got participant {record['participant']})")
    return record


def write_record(folder: Path, session: Session) -> None:
    """Write the record, which seals the manifests of all attempts (and they their runs) and the later answers."""
    attempts = [attempt.folder for attempts in session.attempts.values() for attempt in attempts]
    names = [f"{name}/{seal.MANIFEST}" for name in attempts]
    pages = [page for name in attempts for page in folders_of_later_answers(folder / name)]
    names += [f"{page.name}/{PROBES}" for page in pages]
    files = seal.digests(folder, [name for name in names if (folder / name).exists()])
    seal.write_sealed(folder / RECORD, session.record, files)


def unsealed_in(folder: Path, record: dict[str, Any]) -> list[str]:
    """Return what a participant's tables rest on and nothing vouches for: runs and answers from before seals."""
    attempts = [attempt["folder"] for run in record["runs"] for attempt in run["attempts"]]
    found = [f"{name}/{file}" for name in attempts for file in _not_sealed(folder / name)]
    names = [f"{page.name}/{PROBES}" for name in attempts for page in folders_of_later_answers(folder / name)]
    return found + seal.not_sealed(record, [name for name in names if (folder / name).exists()])


def _not_sealed(run: Path) -> list[str]:
    return seal.not_sealed(seal.read_sealed(run / seal.MANIFEST), results_in(run))


def attempts_at(folder: Path, run: PlannedRun) -> list[Attempt]:
    """Return all attempts at a run that have ended, in order.

    Raises:
        CommandError: a summary cannot be read, or a file of an attempt has been changed.
    """
    found: list[Attempt] = []
    for name in _names_of_attempts(folder, run):
        here = folder / name
        if (here / SUMMARY).exists():
            answered = frozenset(row["probe"] for row in answers(here) if row["answered_utc"])
            found.append(Attempt(name, summary_of(here), scenario_of(run, name, found), answered))
    return found


def scenario_of(run: PlannedRun, folder: str, earlier: Sequence[Attempt]) -> Scenario:
    """Return the scenario of the attempt in a folder of this name, after these."""
    return run.attempt(_attempt_number(folder, run), is_repeat=any(attempt.is_valid for attempt in earlier))


def summary_of(run: Path) -> dict[str, Any]:
    """Return the summary of a run with what was known only after it: later answers, and how many were right.

    Raises CommandError, as above.
    """
    seal.checked(run / seal.MANIFEST)
    summary = _with_later_answers(run, _having(run / SUMMARY, seal.read_sealed(run / SUMMARY), "complete"))
    if rows := read_rows(run / SITUATION):
        summary["person"] = {**(summary.get("person") or {}), **shares(rows)}
    return summary


def answers(folder: Path) -> list[Row]:
    """Return the rows of a run's answers; an answer that was given later stands in place of its absence."""
    later = _later(folder)
    given = {(row["probe"], row["item"]) for row in later}
    first = [
        row for row in read_rows(folder / PROBES) if row["answered_utc"] or (row["probe"], row["item"]) not in given
    ]
    return [*first, *later]


def folders_of_later_answers(folder: Path) -> list[Path]:
    """Return the folders of the pages that asked again after a run, in order."""
    return sorted(folder.parent.glob(f"{folder.name}.again-*"), key=lambda path: int(path.name.rpartition("-")[2]))


def _with_later_answers(folder: Path, summary: dict[str, Any]) -> dict[str, Any]:
    later = _later(folder)
    person = summary.get("person")
    if not later or not isinstance(person, dict):
        return summary
    missing = (person.get("answers_missing") or 0) - len({row["probe"] for row in later})
    changed = {**person, "answers_missing": max(0, missing)}
    for technique in TECHNIQUES:
        if technique.when == AFTER and (rows := [row for row in later if row["probe"] == technique.name]):
            changed |= technique.scores([{row["item"]: float(row["value"]) for row in rows}])
    return {**summary, "person": changed}


def _later(folder: Path) -> list[Row]:
    """Return the answers that were given after a run."""
    return [row for page in folders_of_later_answers(folder) for row in read_rows(page / PROBES) if row["answered_utc"]]


def _names_of_attempts(folder: Path, run: PlannedRun) -> list[str]:
    """Return the names of the folders of all attempts at a run: further attempts have a number behind the name."""
    names = [path.name for path in folder.iterdir()] if folder.exists() else []
    return sorted((name for name in names if _attempt_number(name, run)), key=lambda name: _attempt_number(name, run))


def _attempt_number(name: str, run: PlannedRun) -> int:
    """Return which attempt at a run a folder of this name is; 0: none."""
    number = name.removeprefix(f"{run.folder}-")
    return 1 if name == run.folder else int(number) if number != name and number.isdecimal() else 0


def _having(file: Path, content: dict[str, Any], needed: str) -> dict[str, Any]:
    """Return the content of a file if it has this key. Raises CommandError: it has not, or there is no file."""
    if needed not in content:
        reason = f"it has no {needed!r}" if content else "it is missing"
        raise CommandError(f"{file} must be a whole file of this session ({reason}); restore it, or move it away")
    return content
