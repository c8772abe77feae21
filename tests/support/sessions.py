"""Files of sessions, and sessions whose runs are pretended."""

import argparse
import csv
import json
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_cli import report
from deltaswarm_orchestrator.base.output import results_on
from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_orchestrator.run.options import RunOptions
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_scenario.person_tables import OperatorAction, ProbeRow
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_serving import alone
from deltaswarm_sessions import doing
from deltaswarm_sessions.folder import RECORD
from deltaswarm_sessions.plan import PlannedRun, plan
from deltaswarm_sessions.session import Attempt, Session
from deltaswarm_sessions.settings import load_session

FILE = """
schema = 1

[session]
speed = 5.0
consent = "consent.txt"

[session.training]
label = "training"
scenario = "smoke"
set = ["run.duration_s=60"]
"""
CONDITION = '\n[[session.condition]]\nlabel = "{0}"\nscenario = "smoke"\nset = ["control.delta={1}"]\n'


def a_file(folder: Path, conditions: int = 3, more: str = "") -> Path:
    """A session's file, and its text of consent."""
    file = folder / "deltas.toml"
    labels = "ABCDEFGHIJKL"[:conditions]
    file.write_text(FILE + more + "".join(CONDITION.format(label, 2 + n) for n, label in enumerate(labels)))
    (folder / "consent.txt").write_text('You may stop at any time.\nSay "stop".\n')
    return file


def a_command(folder: Path, conditions: int = 2, more: str = "") -> list[str]:
    """The command for sessions below `out`."""
    return ["session", str(a_file(folder, conditions, more)), "--out", str(folder / "out")]


FORMS = """
[[session.form]]
name = "you"
when = "before"
question = [{ name = "age", text = "How old are you?", kind = "number", low = 18, high = 99 }]

[[session.form]]
name = "trust"
when = "between"
question = [{ name = "reliable", text = "The swarm is reliable." }, { name = "why", text = "Why?", kind = "text" }]

[[session.form]]
name = "end"
when = "after"
question = [{ name = "best", text = "Which run was best?", kind = "choice", choices = ["first", "second"] }]
"""


def with_criterion(metric: str = "read", bound: str = "at_least = 5", more: str = "") -> str:
    """The part of a session's file."""
    return f'\n[session.training.criterion]\nmetric = "{metric}"\n{bound}\n{more}\n'


def a_session(folder: Path, conditions: int = 2, more: str = "", participant: int = 1) -> Session:
    """A session of which nothing is done."""
    settings, beside = load_session(str(a_file(folder, conditions, more)))
    return Session(participant, plan(settings, participant, beside))


def do(session: Session, run: PlannedRun, *, answered: tuple[str, ...] = (), **summary: Any) -> Attempt:
    """Pretend that a run has been done, completely unless its summary says otherwise."""
    number = len(session.attempts[run.folder]) + 1
    name = run.folder if number == 1 else f"{run.folder}-{number}"
    whole = {"complete": True, "digest": "ff", **summary}
    is_repeat = any(attempt.is_valid for attempt in session.attempts[run.folder])
    attempt = Attempt(name, whole, run.attempt(number, is_repeat=is_repeat), frozenset(answered))
    session.attempts[run.folder].append(attempt)
    return attempt


def run_here(arguments: argparse.Namespace, ready: doing.Ready) -> int:
    """Do a session's runs without pages and processes."""
    doing.begin(ready.runner, ready.out, ready.begun)
    with results_on(sys.stderr) if arguments.json else nullcontext():
        return ready.runner.run()


class Pretended:
    """Stands for the command for runs: writes a summary of each, complete unless told otherwise."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *summaries: dict[str, Any]) -> None:
        self.summaries = list(summaries)
        self.scenarios: list[Scenario] = []
        self.options: list[RunOptions] = []
        monkeypatch.setattr(report, "run_and_report", self)
        monkeypatch.setattr(alone, "serve", run_here)

    @property
    def done(self) -> list[str]:
        return [options.out.name for options in self.options]

    def __call__(self, scenario: Scenario, options: RunOptions, *, quiet: bool) -> int:
        summary = {"complete": True, "digest": "d", **(self.summaries.pop(0) if self.summaries else {})}
        self.scenarios.append(scenario)
        self.options.append(options)
        options.out.mkdir()
        (options.out / "scenario.toml").write_text(to_toml(scenario))
        (options.out / "summary.json").write_text(json.dumps(summary))
        print("the table of a run")
        return 0 if summary["complete"] else 1


SUMMARY: dict[str, Any] = {
    "complete": True,
    "valid": True,
    "seed": 2**53 - 1,
    "digest": "00ff",
    "waiting_time_s": {"restricted_mean": 12.5},
    "person": {"items": 7, "isa": 3.5, "answers_missing": 1, "tlx": {"raw": 40.0}, "commands_by_state": {"done": 2}},
}


def a_participant(sessions: Path, number: int, conditions: Sequence[str]) -> Path:
    """The folder of a session of these conditions, whose runs have an act and an answer each."""
    here = sessions / f"participant-{number:03}"
    runs = []
    for place, condition in enumerate(conditions):
        run = here / f"{place}-{condition}"
        run.mkdir(parents=True)
        (run / "summary.json").write_text(json.dumps(SUMMARY))
        act = OperatorAction(place, "note", utc="2026-11-26T02:00:00.001Z", text=f'tab\tand "quote"\nof {number}')
        write_csv(run / "actions.csv", act._fields, [act])
        write_csv(run / "probes.csv", ProbeRow._fields, [ProbeRow("isa", 0, "isa", None, 120.0, None)])
        attempt = {"folder": run.name, "complete": True, "digest": "00ff", "answers_missing": 1}
        runs.append({"place": place, "condition": condition, "stream": place, "attempts": [attempt]})
    (here / RECORD).write_text(json.dumps({"participant": number, "runs": runs}))
    return here


def edited(file: Path, **entries: Any) -> None:
    """Replace entries of a JSON file."""
    file.write_text(json.dumps(json.loads(file.read_text()) | entries))


def rows_of(file: Path) -> list[dict[str, str]]:
    """The rows of a table."""
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream, delimiter="\t"))
