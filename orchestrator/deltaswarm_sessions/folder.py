"""A participant's folder: the record `session.json`, the attempts at each run, and all answers given in it or later."""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import inputs, seal
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.frozen import changed_keys
from deltaswarm_orchestrator.recording import PART, SCENARIO
from deltaswarm_orchestrator.results.folder import results_in
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError, is_held
from deltaswarm_orchestrator.results.run_tables import PROBES, SITUATION
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.columns import columns_of
from deltaswarm_scenario.person_tables import TABLES
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.situation import shares
from deltaswarm_scenario.technique import AFTER
from deltaswarm_scenario.techniques import TECHNIQUES
from deltaswarm_sessions.plan import PlannedRun, run_folder
from deltaswarm_sessions.session import Attempt, Session
from deltaswarm_wire.cells import rows_by_column
from deltaswarm_wire.checked import plain
from deltaswarm_wire.reading import decoded

RECORD, SUMMARY = "session.json", "summary.json"

Row = dict[str, str]

NUMERIC = {technique.name for technique in TECHNIQUES if technique.has_numbers}
NEEDED = {
    "actions": ("kind", "name", "text"),
    "probes": ("probe", "number", "item", "value", "answered_utc"),
    "wall_times": ("monotonic_s",),
}
"""Columns that a run's table must have; tables of earlier versions lack others."""


def folder_name(participant: int) -> str:
    return f"participant-{participant:03}"


def locked(folder: Path) -> FolderLock:
    try:
        return FolderLock(folder)
    except HeldError:
        raise CommandError(f"{folder} must be free: a session of this participant is under way") from None


def check_design(folder: Path, session: Session) -> None:
    """Refuse to go on with a session whose file has changed: runs of two designs would pass for those of one."""
    hint = "undo the change of the session's file, or choose another folder by --out"
    if (folder / RECORD).exists():
        before = [run["condition"] for run in read_record(folder)["runs"]]
        if before != (now := [run.label for run in session.runs]):
            raise CommandError(f"{folder} must be of the runs {', '.join(now)} (got {', '.join(before)}): {hint}")
    for attempt in (attempt for attempts in session.attempts.values() for attempt in attempts if attempt.is_valid):
        file = folder / attempt.folder / SCENARIO
        if changed := changed_keys(plain(attempt.scenario), plain(load_scenario(str(file)))):
            raise CommandError(f"{file} must be as planned (other values of {', '.join(changed)}): {hint}")
        was, is_now = seal.read_sealed(file.with_name(seal.MANIFEST)).get("inputs"), inputs.identify(attempt.scenario)
        if was and (other := inputs.differences({**was, inputs.CODE: is_now[inputs.CODE]}, is_now)):
            raise CommandError(f"{file.parent} must be done with the same files (changed since: {other}): undo that")


def read_record(folder: Path) -> dict[str, Any]:
    """Return the record in a participant's folder. Runs whose folders have been deleted are no longer vouched for."""
    record = intact_record(folder)
    if folder.name != (own := folder_name(record["participant"])):
        raise CommandError(
            f"{folder / RECORD} must be of this participant (got participant {record['participant']}); give the folder "
            f"its name {own}, and correct a wrong number by --renumber"
        )
    return record


def intact_record(folder: Path) -> dict[str, Any]:
    """Return the record in a participant's folder whatever the folder's name is."""
    sealed = seal.files_of(seal.read_sealed(folder / RECORD))
    deleted = {name for name in sealed if not (folder / name).parent.exists()}
    return _having(folder / RECORD, seal.checked(folder / RECORD, deleted=deleted), "runs")


def write_record(folder: Path, session: Session) -> None:
    """Write the record, which seals the manifests of all attempts (and they their runs) and the later answers."""
    attempts = [attempt.folder for attempts in session.attempts.values() for attempt in attempts]
    manifests = [name for attempt in attempts if (folder / (name := f"{attempt}/{seal.MANIFEST}")).exists()]
    files = seal.digests(folder, [*manifests, *_later_files(folder, attempts)])
    seal.write_sealed(folder / RECORD, session.record, files)


def _later_files(folder: Path, attempts: Iterable[str]) -> list[str]:
    """Return the tables of answers that were given after these attempts."""
    pages = [page for name in attempts for page in folders_of_later_answers(folder / name)]
    return [f"{page.name}/{PROBES}" for page in pages if (page / PROBES).exists()]


def unsealed_in(folder: Path, record: dict[str, Any]) -> list[str]:
    """List files behind a participant's tables that no seal covers: runs and answers of earlier versions."""
    recorded = (attempt["folder"] for run in record["runs"] for attempt in run["attempts"])
    attempts = [name for name in recorded if (folder / name).exists() and not name.endswith(PART)]
    found = [
        f"{name}/{file}"
        for name in attempts
        for file in seal.not_sealed(seal.read_sealed(folder / name / seal.MANIFEST), results_in(folder / name))
    ]
    return found + seal.not_sealed(record, _later_files(folder, attempts))


def attempts_at(folder: Path, run: PlannedRun) -> list[Attempt]:
    """Return all attempts at a run that have ended, in order, with those that were killed."""
    found: list[Attempt] = []
    for name in names_of_attempts(folder, run.folder):
        here = folder / name
        answered = frozenset(row["probe"] for row in answers(here) if row["answered_utc"])
        found.append(Attempt(name, summary_of(here), scenario_of(run, name, found), answered))
    return found


def scenario_of(run: PlannedRun, folder: str, earlier: Sequence[Attempt]) -> Scenario:
    return run.attempt(attempt_number(folder, run.folder), is_repeat=any(attempt.is_valid for attempt in earlier))


def summary_of(run: Path) -> dict[str, Any]:
    """Return the summary of a run with what was known only after it: later answers, and how many were right.

    A killed run has no summary of its own, and no measures.
    """
    manifest = seal.checked(run / seal.MANIFEST)
    if _is_killed(run):
        return {"complete": False, "digest": None, "seed": manifest.get("seed")}
    summary = _with_later_answers(run, _having(run / SUMMARY, seal.read_sealed(run / SUMMARY), "complete"))
    if rows := rows_in(run / SITUATION):
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
    try:
        data = file.read_bytes() if file.exists() else b""
        is_cut = bool(data) and not data.endswith(b"\n")  # maybe in the middle of a character
        rows = rows_by_column(StringIO(data.decode(errors="ignore") if is_cut else decoded(data), newline=""))
        rows = [row for row in (rows[:-1] if is_cut else rows) if None not in row.values()]
        _check_cells(rows, file.stem)
    except (OSError, ValueError, csv.Error) as error:
        raise CommandError(f"{file} must be a table as a run writes it: {error}; restore it") from None
    return rows


def _check_cells(rows: Sequence[Row], table: str) -> None:
    numbers = {name for name, (kind, _) in columns_of(TABLES[table]).items() if kind != "text"}
    for row_number, row in enumerate(rows, 2):  # the header is the first
        if lacking := [name for name in NEEDED.get(table, ()) if name not in row]:
            raise ValueError(f"it lacks the columns {', '.join(lacking)}")
        own = {"value"} if row.get("probe") in NUMERIC else set()
        for name in (numbers | own) & {*row}:
            if row[name] and not is_finite(row[name]):
                raise ValueError(f"row {row_number}, column {name}: must be a finite number (got {row[name]!r:.40})")


def is_finite(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


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
            changed |= technique.scores(
                [{row["item"]: float(row["value"]) if technique.has_numbers else row["value"] for row in rows}]
            )
    return {**summary, "person": changed}


def _later(folder: Path) -> list[Row]:
    return [row for page in folders_of_later_answers(folder) for row in rows_in(page / PROBES) if row["answered_utc"]]


def attempts_of(folder: Path, run: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the attempts at a run of a record in order, by folder, with their entries; {} for one without an entry."""
    first = run_folder(run["place"], run["condition"])
    recorded = {attempt["folder"]: attempt for attempt in run["attempts"]}
    names = {*recorded, *names_of_attempts(folder, first)}
    return {name: recorded.get(name, {}) for name in sorted(names, key=lambda name: attempt_number(name, first))}


def names_of_attempts(folder: Path, run: str) -> list[str]:
    """Return the folders of all attempts at a run that are not in progress, by the name of its first attempt's."""
    found = [path for path in folder.iterdir() if attempt_number(path.name, run)] if folder.exists() else []
    ended = (path.name for path in found if (path / SUMMARY).exists() or _is_killed(path))
    return sorted(ended, key=lambda name: attempt_number(name, run))


def attempt_number(name: str, run: str) -> int:
    """Return the number of the attempt in a folder of this name; 0 if it holds no attempt at this run."""
    name = name.removesuffix(PART)
    number = name.removeprefix(f"{run}-")
    return 1 if name == run else int(number) if number != name and number.isdecimal() else 0


def _is_killed(run: Path) -> bool:
    """Return whether a run began and was killed, so that it has no summary, and its rows may be cut off."""
    return (run / seal.MANIFEST).exists() and not (run / SUMMARY).exists() and not is_held(run)


def _having(file: Path, content: dict[str, Any], needed: str) -> dict[str, Any]:
    if needed not in content:
        reason = f"it has no {needed!r}" if content else "it is missing"
        raise CommandError(f"{file} must be a whole file of this session ({reason}); restore it, or move it away")
    return content
