"""Read a recording back: the numbers of a run, exactly as they were written.

The recording of a killed run can be read too. It holds what had been flushed, and `complete` is false.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.records import Attachment, McapRecord, Metadata

from deltaswarm_orchestrator.recording.names import PART, RECORDING
from deltaswarm_orchestrator.recording.recorder import MANIFEST, SCENARIO_ATTACHMENT
from deltaswarm_orchestrator.recording.records import Messages, records, row_of, values_of
from deltaswarm_scenario.truth import EventState, StepRecord
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import Answer, Report, ReportedMember, Workload


@dataclass
class Recording:
    """The numbers in a recording. What is only for viewing is not read."""

    step_records: list[StepRecord] = field(default_factory=list)
    """One per step, in order."""
    events: list[EventState] = field(default_factory=list)
    """Each event's last known state, by id."""
    workloads: list[Workload] = field(default_factory=list)
    """One per step, in order."""
    reports: dict[int, tuple[Report, ...]] = field(default_factory=dict)
    """The reports that arrived in each step, by step; empty where none arrived."""
    scenario: str = ""
    """The effective scenario, as TOML."""
    metadata: dict[str, str] = field(default_factory=dict)
    """The manifest; empty if the recording was never closed."""
    complete: bool = False
    """Whether the recording was closed with its manifest and nothing is missing."""


FIGURES = frozenset({"/net/stats", "/swarm/state", "/swarm/event", "/operator/inbox", "/operator/workload"})
"""The topics that are read."""


def recording_in(path: Path) -> Path:
    """Return the file itself, or the recording in a run's folder: the finished one, else the partial one."""
    if not path.is_dir():
        return path
    whole = path / RECORDING
    return whole if whole.exists() else whole.with_name(RECORDING + PART)


def read_recording(path: Path) -> Recording:
    """Read the recording in a file or in a run's folder, whether it was finished or cut off.

    Raises:
        FileNotFoundError: there is no recording.
        RecordingError: the file is not an MCAP file.
    """
    reader = _Reader()
    for record in records(recording_in(path)):
        if record is None:
            return reader.recording(is_whole=False)
        reader.take(record)
    return reader.recording(is_whole=True)


class _Reader:
    """Collects the numbers of a run, record by record."""

    def __init__(self) -> None:
        self._found = Recording()
        self._messages = Messages(FIGURES)
        self._events: dict[int, EventState] = {}
        self._net: dict[int, dict[str, Any]] = {}
        self._state: dict[int, dict[str, Any]] = {}

    def take(self, record: McapRecord) -> None:
        if found := self._messages.take(record):
            self._take_message(*found)
        elif isinstance(record, Attachment) and record.name == SCENARIO_ATTACHMENT:
            self._found.scenario = record.data.decode()
        elif isinstance(record, Metadata) and record.name == MANIFEST:
            self._found.metadata = dict(record.metadata)
            self._found.complete = True

    def _take_message(self, topic: str, message: Any) -> None:
        match topic:
            case "/net/stats":
                self._net[message.step] = values_of(message)
            case "/swarm/state":
                self._state[message.step] = values_of(message)
            case "/swarm/event":
                self._events[message.event] = row_of(EventState, values_of(message))
            case "/operator/inbox":
                self._found.reports[message.step] = tuple(_report(report) for report in message.reports)
            case "/operator/workload":
                self._found.workloads.append(row_of(Workload, values_of(message)))

    def recording(self, is_whole: bool) -> Recording:
        """Return what was found; if it is incomplete, the step_records end before the first missing step."""
        found = self._found
        found.complete &= is_whole
        found.events = sorted(self._events.values(), key=lambda event: (event.arrived_s, event.event))
        steps = sorted(self._net.keys() & self._state)
        if not found.complete:  # damage can hide a whole chunk
            steps = [step for place, step in enumerate(steps) if step == steps[0] + place]
        found.step_records = [row_of(StepRecord, {**self._net[step], **self._state[step]}) for step in steps]
        return found


def _report(message: Any) -> Report:
    kinds = {"events": Event, "members": ReportedMember, "answers": Answer}
    rows = {name: tuple(row_of(kind, values_of(row)) for row in getattr(message, name)) for name, kind in kinds.items()}
    return Report(**{**values_of(message), **rows})
