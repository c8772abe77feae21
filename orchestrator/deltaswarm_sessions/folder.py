"""A participant's folder: the record `session.json`, the attempts at each run, and all answers given in it or later."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import inputs, seal
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.recording import PART, SCENARIO
from deltaswarm_orchestrator.results.folder import results_in
from deltaswarm_orchestrator.results.folder_lock import is_held
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
        was, is_now = seal.read_sealed(file.with_name(seal.MANIFEST)).get("inputs"), inputs.identify(attempt.scenario)
        if was and (other := inputs.differences({**was, inputs.CODE: is_now[inputs.CODE]}, is_now)):
            raise CommandError(f"{file.parent} must be done with the same files (changed since: {other}): undo that")


def read_record(folder: Path) -> dict[str, Any]:
    """Return the record in a participant's folder. Runs whose folders have been deleted are no longer vouched for.

    Raises:
        CommandError: it cannot be read, or it, or a file that it seals, has been changed.
    """
    sealed = seal.files_of(seal.read_sealed(folder / RECORD))
    deleted = {name for name in sealed if not (folder / name).parent.exists()}
    record = _having(folder / RECORD, seal.checked(folder / RECORD, deleted=deleted), "runs")
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
    recorded = (attempt["folder"] for run in record["runs"] for attempt in run["attempts"])
    attempts = [name for name in recorded if (folder / name).exists() and not name.endswith(PART)]
    found = [f"{name}/{file}" for name in attempts for file in _not_sealed(folder / name)]
    names = [f"{page.name}/{PROBES}" for name in attempts for page in folders_of_later_answers(folder / name)]
    return found + seal.not_sealed(record, [name for name in names if (folder / name).exists()])


def _not_sealed(run: Path) -> list[str]:
    return seal.not_sealed(seal.read_sealed(run / seal.MANIFEST), results_in(run))


def attempts_at(folder: Path, run: PlannedRun) -> list[Attempt]:
    """Return all attempts at a run that have ended, in order, with those that were killed.

    Raises:
        CommandError: a summary cannot be read, or a file of an attempt has been changed.
    """
    found: list[Attempt] = []
    for name in names_of_attempts(folder, run.folder):
        here = folder / name
        answered = frozenset(row["probe"] for row in answers(here) if row["answered_utc"])
        found.append(Attempt(name, summary_of(here), scenario_of(run, name, found), answered))
    return found


def scenario_of(run: PlannedRun, folder: str, earlier: Sequence[Attempt]) -> Scenario:
    """Return the scenario of the attempt in a folder of this name, after these."""
    return run.attempt(attempt_number(folder, run.folder), is_repeat=any(attempt.is_valid for attempt in earlier))


def summary_of(run: Path) -> dict[str, Any]:
    """Return the summary of a run with what was known only after it: later answers, and how many were right.

    A killed run has no summary of its own, and no measures.

    Raises CommandError, as above.
    """
    manifest = seal.checked(run / seal.MANIFEST)
    if _is_killed(run):
        return {"complete": False, "digest": None, "seed": manifest.get("seed")}
    summary = _with_later_answers(run, _having(run / SUMMARY, seal.read_sealed(run / SUMMARY), "complete"))
    if rows := read_rows(run / SITUATION):
        summary["person"] = {**(summary.get("person") or {}), **shares(rows)}
    return summary


def answers(folder: Path) -> list[Row]:
    """Return the rows of a run's answers; an answer that was given later stands in place of its absence."""
    later = _later(folder)
    given = {(row["probe"], row["item"]) for row in later}
    first = [row for row in rows_in(folder / PROBES) if row["answered_utc"] or (row["probe"], row["item"]) not in given]
    return [*first, *later]


def rows_in(file: Path) -> list[Row]:
    """Return the rows of a table of a run, without a last one that a kill cut off."""
    rows = read_rows(file)
    is_cut = bool(rows) and not file.read_bytes().endswith(b"\n")
    return [row for row in (rows[:-1] if is_cut else rows) if None not in row.values()]


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


def names_of_attempts(folder: Path, run: str) -> list[str]:
    """Return the folders of all attempts at a run that are not in progress, by the name of its first attempt's."""
    found = [path for path in folder.iterdir() if attempt_number(path.name, run)] if folder.exists() else []
    ended = (path.name for path in found if (path / SUMMARY).exists() or _is_killed(path))
    return sorted(ended, key=lambda name: attempt_number(name, run))


def attempt_number(name: str, run: str) -> int:
    """Return which attempt at a run a folder of this name is: later ones have a number behind the name; 0: none."""
    name = name.removesuffix(PART)
    number = name.removeprefix(f"{run}-")
    return 1 if name == run else int(number) if number != name and number.isdecimal() else 0


def _is_killed(run: Path) -> bool:
    """Return whether a run began and was killed, so that it has no summary, and its rows may be cut off."""
    return (run / seal.MANIFEST).exists() and not (run / SUMMARY).exists() and not is_held(run)


def _having(file: Path, content: dict[str, Any], needed: str) -> dict[str, Any]:
    """Return the content of a file if it has this key. Raises CommandError: it has not, or there is no file."""
    if needed not in content:
        reason = f"it has no {needed!r}" if content else "it is missing"
        raise CommandError(f"{file} must be a whole file of this session ({reason}); restore it, or move it away")
    return content
