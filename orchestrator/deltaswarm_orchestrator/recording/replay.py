"""Turn a recording into the steps that reached the operator, for a replay on the station's page."""

import csv
import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.recording import ACTIONS, COMMANDS
from deltaswarm_orchestrator.recording.reader import RecordingError, read_recording
from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_scenario.operator_settings import AutonomySettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.operator_messages import Clock, encode_report
from deltaswarm_wire.plugins import find_controller


def write_steps(run: Path, file: Path) -> None:
    """Write the briefing and the steps of a run, as `deltaswarm_operator.io.replaying` reads them.

    Raises:
        RecordingError: the recording is damaged, is of another run, or holds no step.
        SealError: a table of the run is not as the run wrote it.
        FileNotFoundError: there is no recording.
    """
    seal.checked(run / seal.MANIFEST)
    recording = read_recording(run)
    if not recording.workloads:
        raise RecordingError("the recording must hold at least one step (got none)")
    table = tomllib.loads(recording.scenario)
    scenario = checked.load(Scenario, table)
    person = scenario.operator.person
    read: dict[float, list[int]] = {}
    actions = _actions(run)
    if not person.commands:  # a simulated person commands again by itself
        scenario = checked.load(Scenario, table | _commands(run, actions, scenario.run.step_s))
    if not person.is_on:  # and reads again
        for row in actions:
            if row["kind"] == "read":
                read.setdefault(float(row["time_s"]), []).extend(map(int, row["items"].split()))
    operator = replace(scenario.operator, autonomy=AutonomySettings())  # what the system commanded is in the script
    scenario = replace(scenario, operator=operator)
    briefing = scenario.for_operator(forms_of(find_controller(scenario.control.mode)), 1.0)
    with file.open("wb") as stream:
        stream.write(msgpack.packb(checked.plain(briefing)))
        last = recording.workloads[-1].step
        for workload in recording.workloads:
            clock = Clock(workload.step, workload.time_s, workload.step == last)
            reports = [encode_report(report) for report in recording.reports.get(workload.step, ())]
            stream.write(msgpack.packb((clock, workload, reports, read.get(workload.time_s, []))))


def _actions(run: Path) -> list[dict[str, str]]:
    """Return the rows of a run's actions; the last row of a killed run may be cut off and is left out."""
    if not (run / ACTIONS).exists():
        return []
    with (run / ACTIONS).open(newline="", encoding="utf-8") as stream:
        return [row for row in csv.DictReader(stream) if None not in row.values()]


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
