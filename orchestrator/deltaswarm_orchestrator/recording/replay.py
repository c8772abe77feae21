"""Turn a recording into the steps that reached the operator, for a replay on the station's page."""

import json
import tomllib
from collections.abc import Iterable
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import msgpack

from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_orchestrator.base.exits import notice
from deltaswarm_orchestrator.recording import ACTIONS, COMMANDS, VALUES
from deltaswarm_orchestrator.recording.reader import RecordingError, read_recording
from deltaswarm_scenario.operator_links import FIRST_STEP, CommandSettings
from deltaswarm_scenario.operator_settings import ALL, AutonomySettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.cells import rows_by_column
from deltaswarm_wire.commands import TARGET_NUMBERS, ArgumentForm, CommandForm, forms_of, named
from deltaswarm_wire.operator_messages import Clock, encode_report
from deltaswarm_wire.plugins import INBOX_POLICIES, find_controller

PROBES = "probes.csv"

ACT_TEXTS = ("kind", "by", "name", "target", "value", "text")
"""Columns of an act that the page shows."""
SHOWN_ACTS = ("command", "veto", "judge", "pace", "note", "help", "end")
SHOWN_PAGE_EVENTS = ("selected", "away", "back")


def worth_of(run: Path) -> Path | None:
    """Return the file that says what the orders of a run were worth; None if `deltaswarm value` has made none."""
    file = run / VALUES / seal.RECORD
    digest = seal.read_sealed(run / seal.MANIFEST).get("digest")
    worth = seal.checked(file)
    return file if worth.get("texts") and worth["run"]["digest"] == digest else None


def write_steps(run: Path, file: Path) -> None:
    """Write the briefing and the steps of a run, as `deltaswarm_operator.io.replaying` reads them.

    Raises:
        RecordingError: the recording is damaged, is of another run, or holds no step.
        SealError: a table of the run is not as the run wrote it.
        FileNotFoundError: there is no recording.
    """
    manifest = seal.checked(run / seal.MANIFEST)
    with provenance.reading(manifest):
        _write_steps(run, file)


def _write_steps(run: Path, file: Path) -> None:
    recording = read_recording(run)
    if not recording.workloads:
        raise RecordingError("the recording must hold at least one step (got none)")
    table = tomllib.loads(recording.scenario)
    scenario = checked.load(Scenario, table)
    person = scenario.operator.person
    read: dict[float, list[int]] = {}
    actions = _rows(run / ACTIONS)
    if not person.commands:  # a simulated person commands again by itself
        scenario = checked.load(Scenario, table | _commands(run, actions, scenario.run.step_s))
    if not person.is_on:  # and reads again
        for row in actions:
            if row["kind"] == "read":
                read.setdefault(float(row["time_s"]), []).extend(map(int, row["items"].split()))
    operator = replace(scenario.operator, autonomy=AutonomySettings())  # what the system commanded is in the script
    if (policy := operator.inbox.policy) not in INBOX_POLICIES.shipped:
        notice(f"replay: the inbox policy {policy} is not run again; the page shows every item")
        operator = replace(operator, inbox=replace(operator.inbox, policy=ALL, options={}))
    scenario = replace(scenario, operator=operator)
    forms = forms_of(find_controller(scenario.control.mode))
    forms += _as_given(command for command in scenario.command if named(forms, command.name) is None)
    briefing = scenario.for_operator(forms, 1.0)
    acts: dict[float, list[dict[str, Any]]] = {}
    for act in acts_of(actions, _rows(run / PROBES)):
        acts.setdefault(act["time_s"], []).append(act)
    times_s = [workload.time_s for workload in recording.workloads]
    for time_s in [time_s for time_s in acts if time_s not in {*times_s}]:  # before the first step, or after a cut
        near_s = max((other_s for other_s in times_s if other_s <= time_s), default=times_s[0])
        acts.setdefault(near_s, []).extend(acts.pop(time_s))
    with file.open("wb") as stream:
        stream.write(msgpack.packb(checked.plain(briefing)))
        last = recording.workloads[-1].step
        for workload in recording.workloads:
            clock = Clock(workload.step, workload.time_s, workload.step == last)
            reports = [encode_report(report) for report in recording.reports.get(workload.step, ())]
            stream.write(
                msgpack.packb((clock, workload, reports, read.get(workload.time_s, []), acts.get(workload.time_s, [])))
            )


def _as_given(commands: Iterable[CommandSettings]) -> tuple[CommandForm, ...]:
    """Return forms of commands that no manifest describes: those of an earlier version of deltaswarm."""
    return tuple(
        CommandForm(
            command.name,
            tuple(TARGET_NUMBERS),
            tuple(
                [
                    ArgumentForm(name, "text" if isinstance(value, str) else "number")
                    for name, value in command.arguments.items()
                ]
            ),
        )
        for command in {command.name: command for command in commands}.values()
    )


def _rows(file: Path) -> list[dict[str, str]]:
    """Return the rows of a table, if there is one; the last row of a killed run may be cut off and is left out."""
    if not file.exists():
        return []
    with file.open(newline="", encoding="utf-8") as stream:
        return [row for row in rows_by_column(stream) if None not in row.values()]


def acts_of(actions: list[dict[str, str]], answers: list[dict[str, str]]) -> list[dict[str, Any]]:
    """Return what the person did and answered in the page's format: a form is one act, when it was asked."""
    acts: list[dict[str, Any]] = []
    for row in actions:
        if row["kind"] in SHOWN_ACTS or (row["kind"] == "page" and row["name"] in SHOWN_PAGE_EVENTS):
            told: dict[str, Any] = {name: row[name] for name in ACT_TEXTS if row[name]}
            told |= {name: int(row[name]) for name in ("event",) if row[name]}
            acts.append({"time_s": float(row["time_s"]), **told})

    def asked(row: dict[str, str]) -> tuple[str, str, str]:
        return row["asked_s"] or row["planned_s"], row["probe"], row["number"]

    for (asked_s, name, _), form in groupby(answers, asked):
        given = "; ".join(f"{row['item']}: {row['value'] or row.get('outcome') or 'no answer'}" for row in form)
        acts.append({"time_s": float(asked_s), "kind": "answer", "name": name, "text": given})
    return sorted(acts, key=lambda act: float(act["time_s"]))


def _commands(run: Path, actions: list[dict[str, str]], step_s: float) -> dict[str, Any]:
    """Return a run's table `command`: the commands that left the base or, if it was killed, those given before."""
    if (run / COMMANDS).exists():
        return tomllib.loads((run / COMMANDS).read_text(encoding="utf-8"))
    given = []
    for row in actions:
        if row["kind"] == "command":
            at_s, life_s = float(row["time_s"]) + FIRST_STEP * step_s, float(row["life_s"])
            numbers = [float(row[name]) for name in ("agent", "x_m", "y_m", "radius_m") if row[name]]
            arguments = json.loads(row["arguments"])
            target = {"target": row["target"], "numbers": numbers}
            given.append({"at_s": at_s, "name": row["name"], **target, "arguments": arguments, "life_s": life_s})
    return {"command": given} if given else {}
