"""The record of one participant's session, `session.json`: the order of the conditions and the attempts at each."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.results.run_tables import read_rows
from deltaswarm_orchestrator.results.situation import SITUATION
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_sessions.again import with_later_answers
from deltaswarm_sessions.session import PlannedRun
from deltaswarm_sessions.training import OPEN, REACHED

RECORD, SUMMARY = "session.json", "summary.json"


class Attempt(NamedTuple):
    """An attempt at a run that has ended."""

    folder: str
    """The folder's name."""
    summary: dict[str, Any]
    """With the answers that were given later."""
    scenario: Scenario
    """As it was planned."""

    @property
    def is_complete(self) -> bool:
        """Whether the run reached its last step."""
        return bool(self.summary["complete"])


def record_of(folder: Path, participant: int, planned: Sequence[PlannedRun]) -> dict[str, Any]:
    """Return the record as the run folders are now. Raises CommandError: a summary cannot be read."""
    language = planned[0].scenario.operator.page.language.tag
    return {
        "participant": participant,
        "language": language,
        "runs": [_run(run, attempts_at(folder, run)) for run in planned],
    }


def _run(run: PlannedRun, attempts: Sequence[Attempt]) -> dict[str, Any]:
    criterion = run.criterion
    rows = [
        {
            "folder": attempt.folder,
            "complete": attempt.summary["complete"],
            "digest": attempt.summary["digest"],
            "answers_missing": (attempt.summary.get("person") or {}).get("answers_missing"),
            **({"training_value": criterion.value(attempt.summary)} if criterion else {}),
        }
        for attempt in attempts
    ]
    row = {
        "place": run.position,
        "condition": run.label,
        "scenario": run.scenario.name,
        "set": list(run.set),
        "stream": run.stream,
        "attempts": rows,
    }
    return row | ({"outcome": outcome_of(run, attempts)} if criterion else {})


def outcome_of(run: PlannedRun, attempts: Sequence[Attempt]) -> str:
    """Return OPEN if the run must be done, or done again; REACHED or NOT_REACHED if it is finished."""
    complete = [attempt.summary for attempt in attempts if attempt.is_complete]
    if run.criterion is None:
        return REACHED if complete else OPEN
    return run.criterion.outcome([run.criterion.value(summary) for summary in complete])


def read_record(folder: Path) -> dict[str, Any]:
    """Return the record in a participant's folder. Raises CommandError: it cannot be read."""
    return read_file(folder / RECORD, "runs")


def attempts_at(folder: Path, run: PlannedRun) -> list[Attempt]:
    """Return all attempts at a run that have ended, in order. Raises CommandError, as above."""
    found: list[Attempt] = []
    for name in names_of_attempts(folder, run):
        if (folder / name / SUMMARY).exists():
            found.append(Attempt(name, summary_of(folder / name), scenario_of(run, name, found)))
    return found


def scenario_of(run: PlannedRun, folder: str, earlier: Sequence[Attempt]) -> Scenario:
    """Return the scenario of the attempt in a folder of this name, after these."""
    return run.attempt(attempt_number(folder, run), is_repeat=any(attempt.is_complete for attempt in earlier))


def summary_of(run: Path) -> dict[str, Any]:
    """Return the summary of a run with what was known only after it: later answers, and how many were right.

    Raises CommandError, as above.
    """
    summary = with_later_answers(run, read_file(run / SUMMARY, "complete"))
    if rows := read_rows(run / SITUATION):
        share = sum(row["is_right"] == "1" for row in rows) / len(rows)
        summary["person"] = {**(summary.get("person") or {}), "situation_right_share": share}
    return summary


def names_of_attempts(folder: Path, run: PlannedRun) -> list[str]:
    """Return the names of the folders of all attempts at a run: further attempts have a number behind the name."""
    names = {path.name.removesuffix(".part") for path in folder.iterdir()} if folder.exists() else set()
    return sorted((name for name in names if attempt_number(name, run)), key=lambda name: attempt_number(name, run))


def attempt_number(name: str, run: PlannedRun) -> int:
    """Return which attempt at a run a folder of this name is; 0: none."""
    number = name.removeprefix(f"{run.folder}-")
    return 1 if name == run.folder else int(number) if number != name and number.isdecimal() else 0


def read_file(file: Path, needed: str) -> dict[str, Any]:
    """Return a JSON file that has this key. Raises CommandError: it cannot be read, or was cut off."""
    try:
        content = dict(json.loads(file.read_text(encoding="utf-8")))
        content[needed]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise CommandError(
            f"{file} must be a whole file of this session ({error!r}); restore it, or move it away"
        ) from None
    return content
