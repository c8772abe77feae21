"""The data of all participants as tidy tables, with a data dictionary.

Each table has a row per observation and a column per variable; by the columns of `KEYS`, tables are joined.
"""

import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import CommandError, complain, notice
from deltaswarm_orchestrator.recording import PART, SCENARIO
from deltaswarm_orchestrator.results.run_tables import PROBES, write_csv
from deltaswarm_orchestrator.results.summary import value_at
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.columns import columns_of
from deltaswarm_scenario.person_tables import TABLES
from deltaswarm_sessions import roster
from deltaswarm_sessions.exclusion import EXCLUDED, ExclusionSettings, exclusions
from deltaswarm_sessions.folder import (
    RECORD,
    answers,
    attempt_number,
    attempts_of,
    folder_name,
    read_record,
    rows_in,
    summary_of,
    unsealed_in,
)
from deltaswarm_sessions.observed import consent_of, of_run, questions_of, version_of
from deltaswarm_sessions.plan import run_folder
from deltaswarm_sessions.roster import Withdrawn, allocated
from deltaswarm_sessions.variables import KEYS, MEASURES, PARTICIPANT, QUESTION, RUN
from deltaswarm_wire.plugins import as_recorded

MAX_NAMED = 8
"""Maximum number of runs named in a line."""

DICTIONARY, PARTICIPANTS, RUNS, QUESTIONS, WIDE = "dictionary", "participants", "runs", "questions", "wide"

Row = Mapping[str, Any]

DELETED: Row = {"complete": False, "invalid_because": ["its folder was deleted"]}
"""The summary of a run whose folder is no longer there."""


def write_tables(
    sessions: Path, out: Path, exclude: ExclusionSettings | None = None, *, is_wide: bool = False
) -> list[Path]:
    """Write the tables of all participants below a folder of sessions; return the files.

    `exclude`: rules whose columns mark runs. `is_wide`: also write a row per participant, as JASP and SPSS need it.
    """
    begun = {file.parent.parent for file in sessions.glob("participant-*/*/*")}
    if lacking := sorted(str(folder) for folder in begun if not (folder / RECORD).exists()):
        raise CommandError(f"{lacking[0]} has runs and no {RECORD}; restore it, or move the folder away")
    folders = sorted(file.parent for file in sessions.glob(f"participant-*/{RECORD}"))
    noted = roster.read(sessions)
    withdrawn = noted.withdrawn
    if not folders and not withdrawn:
        raise CommandError(f"--table needs at least one session in {sessions} (got none); --out says where to look")
    if back := [one for one in withdrawn if (sessions / folder_name(one.participant)).exists()]:
        raise CommandError(
            f"{sessions / folder_name(back[0].participant)} must not be there, since participant "
            f"{back[0].participant} withdrew on {back[0].date}; --withdraw {back[0].participant} deletes it"
        )
    records = {folder: read_record(folder) for folder in folders}
    rules = exclude or ExclusionSettings()
    runs = [run for folder, record in records.items() for run in _runs(folder, record, rules)]
    tables: dict[str, tuple[Iterable[str], Iterable[Row]]] = {
        PARTICIPANTS: (PARTICIPANT, _participants(records, withdrawn)),
        RUNS: ({**KEYS, **RUN}, (run for _, run in runs)),
    }
    tables |= {name: ({**KEYS, **dict.fromkeys(of._fields)}, _of_runs(runs, name)) for name, of in TABLES.items()}
    tables[QUESTIONS] = (QUESTION, _questions(runs))
    if is_wide:
        wide = _wide(runs)
        tables[WIDE] = (dict.fromkeys(name for row in wide for name in row), wide)
    tables[DICTIONARY] = (("table", "column", *_TOLD), _dictionary())
    files = [out / f"{name}.tsv" for name in tables]
    with staged(out / "tables") as part:
        for file, (columns, rows) in zip(files, tables.values(), strict=True):
            write_rows(part / file.name, columns, rows)
        (out / seal.RECORD).unlink(missing_ok=True)  # else tables that are cut off here would seem to be edited
        (out / f"{WIDE}.tsv").unlink(missing_ok=True)
        for file in files:
            (part / file.name).replace(file)
    unsealed = [f"{folder.name}/{name}" for folder, record in records.items() for name in unsealed_in(folder, record)]
    if dropped := sorted({*noted.begun} - {record["participant"] for record in records.values()}):
        complain(f"{sessions}: sessions that were begun and are not there: {', '.join(map(str, dropped))}")
    if unsealed:
        notice(f"{sessions}: not sealed, so nobody can tell whether they were changed: {', '.join(unsealed)}")
    content = {
        "session": sessions.name,
        "sessions": roster.relative(sessions, out),
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


def _runs(folder: Path, record: Row, rules: ExclusionSettings) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yield each attempt of a participant with its row of the table of runs, killed and deleted ones too."""
    for run in record["runs"]:
        keys = {"participant": record["participant"], "condition": run["condition"], "position": run["place"]}
        first = run_folder(run["place"], run["condition"])
        for name, attempt in attempts_of(folder, run).items():
            place = folder / name
            own = {
                "pilot": record.get("pilot", False),
                "attempt": attempt_number(name, first),
                "scenario": run.get("scenario"),
                "set": "; ".join(run.get("set", ())),
                "stream": run.get("stream"),
                "training_value": attempt.get("training_value"),
            }
            summary: dict[str, Any] = {**(summary_of(place) if place.exists() else DELETED), **own}
            rows = {name: _rows(place, name) for name in ("actions", "probes", "wall_times")}
            summary |= of_run(seal.read_sealed(place / seal.MANIFEST), *rows.values())
            summary |= exclusions(rules, summary)
            summary["invalid_because"] = "; ".join(summary.get("invalid_because", ()))
            found = {name: value_at(summary, variable.path) for name, variable in RUN.items()}
            values = {name: int(value) if isinstance(value, bool) else value for name, value in found.items()}
            yield place, {**keys, "run": name.removesuffix(PART), **values}


def _participants(records: Mapping[Path, dict[str, Any]], withdrawn: Iterable[Withdrawn]) -> list[Row]:
    """Return the rows of the table of participants, with the number, date and reason of those who withdrew."""
    gone = [
        {"participant": one.participant, "withdrawn": one.date, "withdrawn_because": one.reason} for one in withdrawn
    ]
    return sorted([*map(_participant, records, records.values()), *gone], key=lambda row: row["participant"])


def _participant(folder: Path, record: dict[str, Any]) -> Row:
    names = [name for run in record["runs"] for name in attempts_of(folder, run)]
    manifests = [seal.read_sealed(folder / name / seal.MANIFEST) for name in names]
    consents = (consent_of(_rows(folder / name, "actions")) for name in names)
    complete = {run["place"]: [one for one in run["attempts"] if one["complete"]] for run in record["runs"]}
    invalid = [one for attempts in complete.values() for one in attempts if not one.get("valid", True)]
    valid = {place: [one for one in attempts if one not in invalid] for place, attempts in complete.items()}
    return {
        "participant": record["participant"],
        "pilot": int(record.get("pilot", False)),
        "allocated": allocated(record),
        "frozen": record.get("frozen", ""),
        "language": record.get("language", ""),
        "started": min(filter(None, (manifest.get("started") for manifest in manifests)), default=""),
        "order": "; ".join(run["condition"] for run in record["runs"] if run["place"]),
        "versions": "; ".join(dict.fromkeys(filter(None, map(version_of, manifests)))),
        "consent": next(filter(None, consents), ""),
        "runs": len(record["runs"]),
        "complete": sum(map(bool, valid.values())),
        "invalid": len(invalid),
        "answers_missing": sum(one.get("answers_missing") or 0 for attempts in valid.values() for one in attempts),
        "training_runs": len(valid.get(0, ())),
        "training_outcome": next((run["outcome"] for run in record["runs"] if "outcome" in run), ""),
    }


def _questions(runs: Iterable[tuple[Path, Row]]) -> list[Row]:
    """Return a row for each question of each condition, once in each language."""
    found: dict[tuple[Any, ...], Row] = {}
    for place, keys in runs:
        if (place / SCENARIO).exists():
            with as_recorded():
                scenario = load_scenario(str(place / SCENARIO))
            for question in questions_of(scenario):
                row = {"condition": keys["condition"], **question}
                found.setdefault(tuple(row.values()), row)
    return list(found.values())


def _wide(runs: Iterable[tuple[Path, Row]]) -> list[dict[str, Any]]:
    """Return a row per participant with the measures of the last valid attempt at each condition."""
    found: dict[int, dict[str, Any]] = {}
    for _, row in runs:
        if row["position"] and row["valid"] != 0 and row["complete"]:
            wide = found.setdefault(row["participant"], {"participant": row["participant"]})
            wide |= {f"{name}.{row['condition']}": row[name] for name in (*MEASURES, EXCLUDED)}
    return list(found.values())


def _of_runs(runs: Iterable[tuple[Path, Row]], name: str) -> Iterator[Row]:
    return ({**keys, **row} for folder, keys in runs for row in _rows(folder, name))


def _rows(run: Path, name: str) -> list[dict[str, str]]:
    file = run / f"{name}.csv"
    return answers(run) if file.name == PROBES else rows_in(file)


_TOLD = ("type", "unit", "meaning")


def _dictionary() -> Iterator[Row]:
    """Yield a row per column of every table."""
    own = {
        PARTICIPANTS: PARTICIPANT,
        QUESTIONS: QUESTION,
        RUNS: {**KEYS, **{name: (kind, column) for name, (kind, column, _) in RUN.items()}},
    }
    for table, columns in (own | {name: {**KEYS, **columns_of(table)} for name, table in TABLES.items()}).items():
        for name, (kind, column) in columns.items():
            yield {"table": table, "column": name, "type": kind, "unit": column.unit, "meaning": column.meaning}


@contextmanager
def staged(out: Path) -> Iterator[Path]:
    """Make a new folder beside `out`, from which the caller moves what is complete; delete the rest at the end."""
    part = out.with_name(f"{out.name}{PART}")
    if part.exists():
        shutil.rmtree(part)  # of a command that was killed
    part.mkdir(parents=True)
    try:
        yield part
    finally:
        shutil.rmtree(part)


def write_rows(file: Path, columns: Iterable[str], rows: Iterable[Row], delimiter: str = "\t") -> None:
    names = list(columns)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_csv(file, names, ([row.get(name, "") for name in names] for row in rows), delimiter, "\n")
