"""The data of all participants as tidy tables, with a data dictionary.

Each table has a row per observation and a column per variable; by the columns of `KEYS`, tables are joined.
"""

import csv
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.participants.again import PROBES, answers
from deltaswarm_orchestrator.participants.record import RECORD, read_record, summary_of
from deltaswarm_scenario.person_tables import TABLES, Column, columns_of

DICTIONARY, PARTICIPANTS, RUNS = "dictionary", "participants", "runs"
WHOLE, NUMBER, TEXT = "whole number", "number", "text"


class Variable(NamedTuple):
    """A column made from a value in JSON, by the path to it."""

    kind: str
    column: Column
    path: str


KEYS = {
    "participant": (WHOLE, Column("", "the participant's number")),
    "condition": (TEXT, Column("", "label of the condition")),
    "position": (WHOLE, Column("", "place of the run in the participant's session; 0: the training")),
    "run": (TEXT, Column("", "folder of the run")),
}

PARTICIPANT = {
    "participant": KEYS["participant"],
    "runs": (WHOLE, Column("", "runs that were planned")),
    "complete": (WHOLE, Column("", "runs that are complete")),
    "answers_missing": (WHOLE, Column("", "questions without an answer, in all complete runs")),
}

RUN = {
    "attempt": Variable(WHOLE, Column("", "number of the attempt at the run, from 1"), "attempt"),
    "complete": Variable(WHOLE, Column("", "1: it reached its last step"), "complete"),
    "valid": Variable(WHOLE, Column("", "1: nothing was lost on the fabric"), "valid"),
    "stream": Variable(WHOLE, Column("", "stream of arrivals, from 0; empty: one of its own"), "stream"),
    "seed": Variable(WHOLE, Column("", "seed of the run"), "seed"),
    "digest": Variable(TEXT, Column("", "digest of all messages"), "digest"),
    "waiting_time_s": Variable(
        NUMBER, Column("s", "mean waiting time, restricted to the horizon"), "waiting_time_s.restricted_mean"
    ),
    "completion_s": Variable(NUMBER, Column("s", "mean time to complete an event, restricted"), "completion_s.mean"),
    "completed": Variable(WHOLE, Column("", "completed events"), "completed"),
    "messages_per_s": Variable(NUMBER, Column("1/s", "messages to the operator"), "operator_messages_per_s.mean"),
    "time_above_threshold_s": Variable(
        NUMBER, Column("s", "time with the message rate above the threshold"), "operator_time_above_threshold_s"
    ),
    "items": Variable(WHOLE, Column("", "items of the inbox"), "person.items"),
    "read": Variable(WHOLE, Column("", "items that were read"), "person.read"),
    "missed": Variable(WHOLE, Column("", "items that were unread for too long"), "person.missed"),
    "acknowledge_s": Variable(NUMBER, Column("s", "mean time until an item was read"), "person.acknowledge_s"),
    "commands": Variable(WHOLE, Column("", "commands given"), "person.commands"),
    "commands_done": Variable(WHOLE, Column("", "commands carried out by an agent"), "person.commands_by_state.done"),
    "share_right": Variable(NUMBER, Column("", "reported events that were judged right"), "task.share_right"),
    "hits": Variable(WHOLE, Column("", "targets that were judged to be targets"), "task.hits"),
    "misses": Variable(WHOLE, Column("", "targets that were judged to be others"), "task.misses"),
    "false_alarms": Variable(WHOLE, Column("", "others that were judged to be targets"), "task.false_alarms"),
    "correct_rejections": Variable(
        WHOLE, Column("", "others that were judged to be others"), "task.correct_rejections"
    ),
    "unjudged": Variable(WHOLE, Column("", "reported events without a judgement"), "task.unjudged"),
    "d_prime": Variable(NUMBER, Column("", "sensitivity d' of the judgements, log-linear"), "task.d_prime"),
    "criterion": Variable(NUMBER, Column("", "criterion c of the judgements; above 0: rather other"), "task.criterion"),
    "isa": Variable(NUMBER, Column("", "mean ISA answer, from 1 to 5"), "person.isa"),
    "questions": Variable(WHOLE, Column("", "questions asked"), "person.questions"),
    "answers_missing": Variable(WHOLE, Column("", "questions without an answer"), "person.answers_missing"),
    "tlx_raw": Variable(NUMBER, Column("", "NASA-TLX, mean of the six scales, from 0 to 100"), "person.tlx.raw"),
    "tlx_weighted": Variable(NUMBER, Column("", "NASA-TLX, weighted by the 15 pairs"), "person.tlx.weighted"),
}

Row = Mapping[str, Any]


def write_tables(sessions: Path, out: Path) -> list[Path]:
    """Write the tables of all participants below a folder of sessions; return the files.

    Raises:
        CommandError: there is no session, or a file of one cannot be read.
    """
    folders = sorted(file.parent for file in sessions.glob(f"participant-*/{RECORD}"))
    if not folders:
        raise CommandError(f"--table needs at least one session in {sessions} (got none); --out says where to look")
    records = {folder: read_record(folder) for folder in folders}
    runs = [run for folder, record in records.items() for run in _runs(folder, record)]
    out.mkdir(parents=True, exist_ok=True)
    files = [
        _write(out / f"{PARTICIPANTS}.tsv", PARTICIPANT, map(_participant, records.values())),
        _write(out / f"{RUNS}.tsv", {**KEYS, **RUN}, (run for _, run in runs)),
    ]
    for name, table in TABLES.items():
        rows = (keys | row for folder, keys in runs for row in _rows(folder, name))
        files.append(_write(out / f"{name}.tsv", {**KEYS, **dict.fromkeys(table._fields)}, rows))
    return [*files, _write(out / f"{DICTIONARY}.tsv", dict.fromkeys(("table", "column", *_TOLD)), _dictionary())]


def _runs(folder: Path, record: Row) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yield each finished attempt of a participant with its row of the table of runs."""
    for run in record["runs"]:
        keys = {"participant": record["participant"], "condition": run["condition"], "position": run["place"]}
        for number, attempt in enumerate(run["attempts"], 1):
            place = folder / attempt["folder"]
            summary = summary_of(place) | {"attempt": number, "stream": run.get("stream")}
            values = {name: _value(summary, variable.path) for name, variable in RUN.items()}
            yield place, {**keys, "run": attempt["folder"], **values}


def _participant(record: Row) -> Row:
    attempts = [attempt for run in record["runs"] for attempt in run["attempts"] if attempt["complete"]]
    return {
        "participant": record["participant"],
        "runs": len(record["runs"]),
        "complete": len(attempts),
        "answers_missing": sum(attempt.get("answers_missing") or 0 for attempt in attempts),
    }


def _value(summary: Row, path: str) -> Any:
    value: Any = summary
    for name in path.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return int(value) if isinstance(value, bool) else value


def _rows(run: Path, name: str) -> Iterator[dict[str, Any]]:
    file = run / f"{name}.csv"
    if file.name == PROBES:
        yield from answers(run)
    elif file.exists():
        with file.open(newline="", encoding="utf-8") as stream:
            yield from csv.DictReader(stream)


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
