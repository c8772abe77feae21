"""Questions of a finished run that have no answer: which they are, asking them again, and the answers given then.

Those about a moment of the run (ISA, SAGAT, SPAM) are not asked again.
"""

import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.processes.station import Station, write_briefing
from deltaswarm_orchestrator.results.run_tables import read_rows
from deltaswarm_orchestrator.results.situation import PROBES
from deltaswarm_scenario.operator_settings import TLX, ProbeSettings
from deltaswarm_scenario.questions import AFTER, FormSettings, tlx_scores
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.session import PASSWORD_VARIABLE

SCORE = "score"
Row = dict[str, str]


def unanswered(folder: Path, scenario: Scenario) -> ProbeSettings | None:
    """Return what to ask again after a run in this folder; None if nothing is missing."""
    answered = {row["probe"] for row in answers(folder) if row["answered_utc"]}
    probes = scenario.operator.probes
    forms = tuple(replace(form, when=AFTER) for form in probes.form if form.question and form.name not in answered)
    has_tlx = probes.tlx and TLX not in answered
    if not has_tlx and not forms:
        return None
    return ProbeSettings(isa_every_s=0.0, tlx=has_tlx, tlx_weights=probes.tlx_weights, form=forms)


SCORE_TITLE = "Your score"
SCORE_TEXT = (
    "Judged right: {right} of {events} reported events. Targets found: {hits}. Targets taken for decoys: {misses}. "
    "Decoys taken for targets: {false_alarms}. Without a judgement: {unjudged}."
)


def score_form(summary: Mapping[str, Any]) -> FormSettings | None:
    """Return the page that tells the person how the task of a run went; None if there was none."""
    task = summary.get("task")
    if not task:
        return None
    right = task["hits"] + task["correct_rejections"]
    return FormSettings(SCORE, SCORE_TITLE, SCORE_TEXT.format(right=right, **task))


def ask_again(folder: Path, scenario: Scenario, probes: ProbeSettings, station: Station) -> None:
    """Ask on the station's page, until all is answered, the time is over or a signal ends it."""
    _ask(folder.with_name(f"{folder.name}.again-{len(_folders(folder)) + 1}"), scenario, probes, station)


def show_score(folder: Path, scenario: Scenario, score: FormSettings, station: Station) -> None:
    """Show the score of a run on the station's page, until the person goes on, or as above."""
    _ask(folder.with_name(f"{folder.name}.{SCORE}"), scenario, ProbeSettings(isa_every_s=0.0, form=(score,)), station)


def _ask(out: Path, scenario: Scenario, probes: ProbeSettings, station: Station) -> None:
    out.mkdir()
    briefing = write_briefing(out, replace(scenario, operator=replace(scenario.operator, probes=probes)), None)
    command = [sys.executable, "-P", "-m", "deltaswarm_operator.io.asking"]
    options = ["--briefing", str(briefing), "--out", str(out), "--listen", station.listen]
    subprocess.run([*command, *options], env={**os.environ, PASSWORD_VARIABLE: station.token}, check=False)


def answers(folder: Path) -> list[Row]:
    """Return the rows of a run's answers; an answer that was given later stands in place of its absence."""
    later = _later(folder)
    given = {(row["probe"], row["item"]) for row in later}
    first = [
        row for row in read_rows(folder / PROBES) if row["answered_utc"] or (row["probe"], row["item"]) not in given
    ]
    return [*first, *later]


def with_later_answers(folder: Path, summary: dict[str, Any]) -> dict[str, Any]:
    """Return a run's summary with the answers that were given later."""
    later = _later(folder)
    person = summary.get("person")
    if not later or not isinstance(person, dict):
        return summary
    missing = (person.get("answers_missing") or 0) - len({row["probe"] for row in later})
    changed = {**person, "answers_missing": max(0, missing)}
    if scales := {row["item"]: float(row["value"]) for row in later if row["probe"] == TLX}:
        changed["tlx"] = tlx_scores(scales)
    return {**summary, "person": changed}


def _later(folder: Path) -> list[Row]:
    """Return the answers that were given after a run."""
    return [row for again in _folders(folder) for row in read_rows(again / PROBES) if row["answered_utc"]]


def _folders(folder: Path) -> list[Path]:
    """Return the folders with later answers, in order."""
    return sorted(folder.parent.glob(f"{folder.name}.again-*"), key=lambda path: int(path.name.rpartition("-")[2]))
