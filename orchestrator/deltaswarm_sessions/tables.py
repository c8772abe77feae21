"""The data of all participants as tidy tables, with a data dictionary.

Each table has a row per observation and a column per variable; by the columns of `KEYS`, tables are joined.
"""

import csv
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import CommandError, complain, notice
from deltaswarm_orchestrator.recording import PART
from deltaswarm_orchestrator.results.run_tables import PROBES
from deltaswarm_orchestrator.results.summary import value_at
from deltaswarm_scenario.columns import columns_of
from deltaswarm_scenario.person_tables import TABLES
from deltaswarm_sessions.folder import (
    RECORD,
    SUMMARY,
    answers,
    attempt_number,
    names_of_attempts,
    read_record,
    rows_in,
    summary_of,
    unsealed_in,
)
from deltaswarm_sessions.plan import run_folder
from deltaswarm_sessions.roster import Withdrawn, allocated, withdrawn_in
from deltaswarm_sessions.variables import KEYS, PARTICIPANT, RUN

MAX_NAMED = 8
"""Maximum number of runs named in a line."""

DICTIONARY, PARTICIPANTS, RUNS = "dictionary", "participants", "runs"

Row = Mapping[str, Any]

DELETED: Row = {"complete": False, "invalid_because": ["its folder was deleted"]}
"""The summary of a run whose folder is no longer there."""


def write_tables(sessions: Path, out: Path) -> list[Path]:
    """Write the tables of all participants below a folder of sessions; return the files.

    Raises:
        CommandError: there is no session, or a file of one cannot be read or has been changed.
    """
    begun = {file.parent.parent for file in sessions.glob(f"participant-*/*/{SUMMARY}")}
    if lacking := sorted(str(folder) for folder in begun if not (folder / RECORD).exists()):
        raise CommandError(f"{lacking[0]} has runs and no {RECORD}; restore it, or move the folder away")
    folders = sorted(file.parent for file in sessions.glob(f"participant-*/{RECORD}"))
    withdrawn = withdrawn_in(sessions)
    if not folders and not withdrawn:
        raise CommandError(f"--table needs at least one session in {sessions} (got none); --out says where to look")
    records = {folder: read_record(folder) for folder in folders}
    runs = [run for folder, record in records.items() for run in _runs(folder, record)]
    out.mkdir(parents=True, exist_ok=True)
    (out / seal.RECORD).unlink(missing_ok=True)  # else tables that are cut off here would seem to be edited
    files = [
        _write(out / f"{PARTICIPANTS}.tsv", PARTICIPANT, _participants(records.values(), withdrawn)),
        _write(out / f"{RUNS}.tsv", {**KEYS, **RUN}, (run for _, run in runs)),
    ]
    for name, table in TABLES.items():
        rows = (keys | row for folder, keys in runs for row in _rows(folder, name))
        files.append(_write(out / f"{name}.tsv", {**KEYS, **dict.fromkeys(table._fields)}, rows))
    files.append(_write(out / f"{DICTIONARY}.tsv", dict.fromkeys(("table", "column", *_TOLD)), _dictionary()))
    unsealed = [f"{folder.name}/{name}" for folder, record in records.items() for name in unsealed_in(folder, record)]
    if unsealed:
        notice(f"{sessions}: not sealed, so nobody can tell whether they were changed: {', '.join(unsealed)}")
    content = {
        "session": sessions.name,
        "participants": [record["participant"] for record in records.values()],
        "not_sealed": unsealed,
    }
    seal.write_sealed(out / seal.RECORD, content, seal.digests(out, [file.name for file in files]))
    if line := invalid_line(runs):
        complain(line)
    return files


def invalid_line(runs: Iterable[tuple[Path, Row]]) -> str:
    """Say how many complete runs are not valid, which, and why the first of them is not; empty if all are."""
    complete = [(f"participant {row['participant']}, {row['run']}", row) for _, row in runs if row["complete"]]
    invalid = [(name, row["invalid_because"]) for name, row in complete if row["valid"] == 0]
    if not invalid:
        return ""
    more = f"; and {len(invalid) - MAX_NAMED} more" if len(invalid) > MAX_NAMED else ""
    named = "; ".join(name for name, _ in invalid[:MAX_NAMED]) + more
    return (
        f"{len(invalid)} of {len(complete)} complete runs are not valid, and are no replicates: {named}. "
        f"For example {invalid[0][0]}: {invalid[0][1]}"
    )


def _runs(folder: Path, record: Row) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yield each attempt of a participant with its row of the table of runs, killed and deleted ones too."""
    for run in record["runs"]:
        keys = {"participant": record["participant"], "condition": run["condition"], "position": run["place"]}
        first = run_folder(run["place"], run["condition"])
        recorded = {attempt["folder"]: attempt for attempt in run["attempts"]}
        names = {*recorded, *names_of_attempts(folder, first)}
        for name in sorted(names, key=lambda name: attempt_number(name, first)):
            attempt, place = recorded.get(name, {}), folder / name
            own = {
                "pilot": record.get("pilot", False),
                "attempt": attempt_number(name, first),
                "scenario": run.get("scenario"),
                "set": "; ".join(run.get("set", ())),
                "stream": run.get("stream"),
                "training_value": attempt.get("training_value"),
            }
            summary: dict[str, Any] = {**(summary_of(place) if place.exists() else DELETED), **own}
            summary["invalid_because"] = "; ".join(summary.get("invalid_because", ()))
            found = {name: value_at(summary, variable.path) for name, variable in RUN.items()}
            values = {name: int(value) if isinstance(value, bool) else value for name, value in found.items()}
            yield place, {**keys, "run": name.removesuffix(PART), **values}


def _participants(records: Iterable[dict[str, Any]], withdrawn: Iterable[Withdrawn]) -> list[Row]:
    """Return the rows of the table of participants, with the number, date and reason of those who withdrew."""
    gone = [
        {"participant": one.participant, "withdrawn": one.date, "withdrawn_because": one.reason} for one in withdrawn
    ]
    return sorted([*map(_participant, records), *gone], key=lambda row: row["participant"])


def _participant(record: dict[str, Any]) -> Row:
    complete = {run["place"]: [one for one in run["attempts"] if one["complete"]] for run in record["runs"]}
    invalid = [one for attempts in complete.values() for one in attempts if not one.get("valid", True)]
    valid = {place: [one for one in attempts if one not in invalid] for place, attempts in complete.items()}
    return {
        "participant": record["participant"],
        "pilot": int(record.get("pilot", False)),
        "allocated": allocated(record),
        "language": record.get("language", ""),
        "runs": len(record["runs"]),
        "complete": sum(map(bool, valid.values())),
        "invalid": len(invalid),
        "answers_missing": sum(one.get("answers_missing") or 0 for attempts in valid.values() for one in attempts),
        "training_runs": len(valid.get(0, ())),
        "training_outcome": next((run["outcome"] for run in record["runs"] if "outcome" in run), ""),
    }


def _rows(run: Path, name: str) -> list[dict[str, str]]:
    file = run / f"{name}.csv"
    return answers(run) if file.name == PROBES else rows_in(file)


_TOLD = ("type", "unit", "meaning")


def _dictionary() -> Iterator[Row]:
    """Yield a row per column of every table."""
    own = {
        PARTICIPANTS: PARTICIPANT,
        RUNS: {**KEYS, **{name: (kind, column) for name, (kind, column, _) in RUN.items()}},
    }
    for table, columns in (own | {name: {**KEYS, **columns_of(table)} for name, table in TABLES.items()}).items():
        for name, (kind, column) in columns.items():
            yield {"table": table, "column": name, "type": kind, "unit": column.unit, "meaning": column.meaning}


def _write(file: Path, columns: Iterable[str], rows: Iterable[Row]) -> Path:
    part = file.with_name(f"{file.name}.part")
    with part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(columns), delimiter="\t", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    part.replace(file)
    return file
