"""Merge the files of a run's parts into its tables, read them back, and score a person's answers."""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import tomli_w

from deltaswarm_orchestrator.base import inputs, provenance
from deltaswarm_orchestrator.base.provenance import sources
from deltaswarm_orchestrator.recording import COMMANDS
from deltaswarm_orchestrator.results.outcome import BY_OPERATOR, EventLife, Outcome
from deltaswarm_scenario.person_tables import TABLES
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.technique import Recorded, ScoredTable
from deltaswarm_scenario.techniques import SCORED
from deltaswarm_scenario.truth import COLUMNS, EventState, StepRecord
from deltaswarm_wire.cells import TableWriter, rows_by_column
from deltaswarm_wire.controller_metrics import PREFIX
from deltaswarm_wire.files import replacing, write_whole
from deltaswarm_wire.operator_messages import Workload
from deltaswarm_wire.plugins import CONTROLLERS

PROBES, SITUATION = "probes.csv", "situation.csv"

EVENTS_SO_FAR = "world-events.csv"
"""One row per change of an event; read if the world did not get to write `events.csv`."""

UNMERGED = ("world.csv", "world.json", "operator.csv", "operator.json", "operator-state.json", EVENTS_SO_FAR)
"""Files of world and operator that are merged into the run's tables."""

OPERATOR_COLUMNS = {name: f"operator_{name}" for name in Workload._fields if name not in ("step", "time_s")}
"""The operator's columns of `series.csv`, keyed by their names in `Workload`."""

RUNNING = "running"
"""The exit reason of a run that has not ended. A killed run keeps it: see `folder_lock.is_held`."""

Row = TypeVar("Row", Workload, EventState)

HINTS: dict[type[Any], dict[str, Any]] = {kind: get_type_hints(kind) for kind in (Workload, EventState)}
"""The types of a row's cells, without their limits."""


def new_manifest(scenario: Scenario, engine: str, record: str, known: inputs.Inputs | None = None) -> dict[str, Any]:
    """Return the manifest of a run that begins: where its results come from; its inputs as they are `known`, or now."""
    return {
        "name": scenario.name,
        "seed": scenario.seed,
        "engine": engine,
        "record": record,
        "started": provenance.now(),
        "exit_reason": RUNNING,
        "digest": None,
        "events_digest": None,
        "versions": provenance.versions(),
        "commit": provenance.commit(),
        "host": provenance.host(),
        "code": provenance.code_digest(),
        "controller": provenance.controller_of(scenario),
        "extensions": [source._asdict() for source in sources(scenario) if source.what != CONTROLLERS.what],
        "inputs": {**(known or inputs.identify(scenario))},
    }


def write_json(file: Path, value: Any) -> None:
    write_whole(file, json.dumps(value, indent=2, allow_nan=False).encode() + b"\n")


def read_outcome(folder: Path) -> Outcome:
    """Read a run folder, merged or not, of a complete or an interrupted run."""
    if (folder / "series.csv").exists():
        rows = _table(folder / "series.csv")
        step_records = [_step_record(row) for row in rows]
        renamed = [{**row, **{name: row[column] for name, column in OPERATOR_COLUMNS.items()}} for row in rows]
        workloads = [_row(Workload, row) for row in renamed if row["messages"]]
    else:
        step_records = [_step_record(row) for row in _table(folder / "world.csv")]
        workloads = [_row(Workload, row) for row in _table(folder / "operator.csv")]
    events = _table(folder / "events.csv")
    if not events:
        events = list({row["event"]: row for row in _table(folder / EVENTS_SO_FAR)}.values())  # the newest of each
    world, operator = (_json(folder / name) for name in ("world.json", "operator.json"))
    states = [_row(EventState, {"worked_s": "", **row}) for row in events]  # runs of earlier versions lack it
    told_s, shown_s, read_s = (_moments(name, operator, events) for name in BY_OPERATOR)
    return Outcome(step_records, states, workloads, world, operator, told_s, shown_s, read_s)


def _moments(name: str, operator: Mapping[str, Any], events: Sequence[Mapping[str, str]]) -> dict[int, float] | None:
    """Return by event when a moment came that the operator's process knows; None if it does not say."""
    moments = operator.get(name)
    if moments is None and events and name in events[0]:
        moments = {row["event"]: row[name] for row in events if row[name]}
    return None if moments is None else {int(event): float(time_s) for event, time_s in moments.items()}


def _json(file: Path) -> dict[str, Any]:
    return dict(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else {}


def _table(file: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file without a last line that was cut off; empty if there is no file."""
    if not file.exists():
        return []
    text = file.read_text(encoding="utf-8")
    lines = text[: text.rfind("\n") + 1].splitlines()
    return list(csv.DictReader(lines))


def _step_record(row: dict[str, str]) -> StepRecord:
    hints = StepRecord.__annotations__
    own = [name for name in row if name not in OPERATOR_COLUMNS.values()]
    kinds = {name: float if name.startswith(PREFIX) else hints.get(name, int) for name in own}
    return StepRecord.of({name: _cell(row[name], kind) for name, kind in kinds.items()})


def _row(kind: type[Row], row: dict[str, str]) -> Row:
    return kind(*(_cell(row[name], HINTS[kind][name]) for name in kind._fields))


def _cell(text: str, hint: Any) -> Any:
    if hint is int:
        return int(text)
    return float(text) if text else None


def write_tables(folder: Path, outcome: Outcome, *, keep_unmerged: bool = False) -> None:
    """Write `series.csv` (one row per step, with the world's and the operator's columns) and `events.csv`.

    Delete the tables of the parts, unless `keep_unmerged` is set because the run may be resumed.
    """
    write_csv(folder / "series.csv", *series_rows(outcome))
    lives = [life._asdict() for life in outcome.lives]
    known = [name for name in EventLife._fields if name not in BY_OPERATOR or getattr(outcome, name) is not None]
    write_csv(folder / "events.csv", known, ([life[name] for name in known] for life in lives))
    if commands := outcome.world.get("commands"):
        write_whole(folder / COMMANDS, tomli_w.dumps({"command": commands}).encode())
    if not keep_unmerged:
        for name in UNMERGED:
            (folder / name).unlink(missing_ok=True)


def series_rows(outcome: Outcome) -> tuple[list[str], Iterator[list[Any]]]:
    by_step = {workload.step: workload for workload in outcome.workloads}

    def rows() -> Iterator[list[Any]]:
        for record in outcome.step_records:
            workload = by_step.get(record.step)
            yield [*record.values(), *(getattr(workload, name, None) for name in OPERATOR_COLUMNS)]

    columns = outcome.step_records[0].columns() if outcome.step_records else COLUMNS
    return [*columns, *OPERATOR_COLUMNS.values()], rows()


def person_tables(folder: Path) -> list[tuple[str, bytes]]:
    """Return the tables about the person at the console, with their names; empty without a person."""
    files = [folder / f"{name}.csv" for name in TABLES]
    return [(file.name, file.read_bytes()) for file in files if file.exists()]


def write_csv(
    file: Path, header: Iterable[str], rows: Iterable[Iterable[Any]], delimiter: str = ",", line_end: str = "\r\n"
) -> None:
    """Write a CSV file atomically."""
    with replacing(file) as stream:
        text = io.TextIOWrapper(stream, newline="", encoding="utf-8")
        table = TableWriter(text, delimiter, line_end)
        table.writerow(header)
        table.writerows(rows)
        text.detach()


def read_rows(file: Path) -> list[dict[str, str]]:
    """Return the rows of a table of a run; none if there is no such table."""
    if not file.exists():
        return []
    with file.open(newline="", encoding="utf-8") as stream:
        return rows_by_column(stream)


def write_scored(folder: Path, outcome: Outcome, scenario: Scenario) -> None:
    """Write a table for each technique that was scored."""
    for table, rows in _scored(folder, outcome, scenario):
        write_csv(folder / f"{table.name}.csv", table.row._fields, rows)


def score_answers(folder: Path, outcome: Outcome, scenario: Scenario) -> dict[str, Any]:
    """Return the summary's part about scored answers; empty if there were none."""
    parts = [table.summarise(rows) for table, rows in _scored(folder, outcome, scenario) if table.summarise]
    return {name: part for summary in parts for name, part in summary.items()}


def _scored(folder: Path, outcome: Outcome, scenario: Scenario) -> Iterator[tuple[ScoredTable, Sequence[Any]]]:
    """Yield the rows of each table that the run has."""
    targets = outcome.world.get("targets")
    run = Recorded(
        lambda name: read_rows(file) if (file := folder / f"{name}.csv").exists() else None,
        outcome.step_records,
        outcome.events,
        None if targets is None else frozenset(targets),
        scenario.arena.width_m,
        scenario.arena.height_m,
    )
    for table in SCORED.values():
        if (rows := table.score(run)) is not None:
            yield table, rows
