"""Compare the person's answers with the truth, as the question techniques score them: tables and the summary's part."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.run_tables import read_rows, write_csv
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.technique import Recorded, ScoredTable
from deltaswarm_scenario.techniques import SCORED

PROBES, SITUATION = "probes.csv", "situation.csv"


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
