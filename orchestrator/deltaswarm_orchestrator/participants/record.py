"""The record of one participant's session, `session.json`: the order of the conditions and the attempts at each."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.participants.again import with_later_answers
from deltaswarm_orchestrator.participants.session import PlannedRun

RECORD = "session.json"


def record_of(folder: Path, participant: int, planned: Sequence[PlannedRun]) -> dict[str, Any]:
    """Return the record as the run folders are now. Raises CommandError: a summary cannot be read."""
    runs = [
        {
            "place": run.position,
            "condition": run.label,
            "stream": run.stream,
            "attempts": [
                {
                    "folder": name,
                    "complete": summary["complete"],
                    "digest": summary["digest"],
                    "answers_missing": (summary.get("person") or {}).get("answers_missing"),
                }
                for name, summary in summaries(folder, run).items()
            ],
        }
        for run in planned
    ]
    return {"participant": participant, "runs": runs}


def read_record(folder: Path) -> dict[str, Any]:
    """Return the record in a participant's folder. Raises CommandError: it cannot be read."""
    return read_file(folder / RECORD, "runs")


def summaries(folder: Path, run: PlannedRun) -> dict[str, dict[str, Any]]:
    """Return the summaries of all attempts at a run, by folder name, in order. Raises CommandError, as above."""
    files = {name: folder / name / "summary.json" for name in attempts(folder, run)}
    return {name: summary_of(file.parent) for name, file in files.items() if file.exists()}


def summary_of(run: Path) -> dict[str, Any]:
    """Return the summary of a run, with the answers that were given later. Raises CommandError, as above."""
    return with_later_answers(run, read_file(run / "summary.json", "complete"))


def attempts(folder: Path, run: PlannedRun) -> list[str]:
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
