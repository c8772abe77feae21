"""A recording as the steps that reached the operator, for a replay at the station's page."""

import tomllib
from pathlib import Path

import msgpack

from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.recording.records import RecordingError
from deltaswarm_wire import checked
from deltaswarm_wire.commands import forms_of
from deltaswarm_wire.operator_messages import Clock, encode_report
from deltaswarm_wire.plugins import find_controller
from deltaswarm_wire.settings import Scenario

COMMANDS = "commands.toml"
"""The commands that left the base, as `deltaswarm run --commands` takes them: the same run again."""


def write_steps(run: Path, file: Path) -> None:
    """Write the briefing and the steps of a run, as `deltaswarm_operator.replaying` reads them.

    Raises:
        RecordingError: the recording is damaged, or holds no step.
        FileNotFoundError: there is none.
    """
    found = read_recording(run)
    if not found.workloads:
        raise RecordingError("the recording must hold at least one step (got none)")
    table = tomllib.loads(found.scenario)
    if (run / COMMANDS).exists():
        table |= tomllib.loads((run / COMMANDS).read_text())
    scenario = checked.load(Scenario, table)
    briefing = scenario.for_operator(forms_of(find_controller(scenario.control.mode)), 1.0)
    with file.open("wb") as stream:
        stream.write(msgpack.packb(checked.plain(briefing)))
        last = found.workloads[-1].step
        for workload in found.workloads:
            clock = Clock(workload.step, workload.time_s, workload.step == last)
            reports = [encode_report(report) for report in found.reports.get(workload.step, ())]
            stream.write(msgpack.packb((clock, workload, reports)))
