"""Reading a recording back: the figures of a run, exactly as they were written.

Also of a run that was killed: what had been flushed is there, and `complete` says that it is not all.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import orjson
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata

from deltaswarm_orchestrator.recording.recorder import MANIFEST, PART, RECORDING, SCENARIO_ATTACHMENT
from deltaswarm_orchestrator.recording.records import records, row_of
from deltaswarm_wire.messages import Event, Report, Workload
from deltaswarm_wire.truth import EventState, Tally


@dataclass
class Recording:
    """What a recording holds of figures; what is only to be looked at stays in the file."""

    tallies: list[Tally] = field(default_factory=list)
    """One per step, in order."""
    events: list[EventState] = field(default_factory=list)
    """Each event's last known state, by id."""
    workloads: list[Workload] = field(default_factory=list)
    """One per step, in order."""
    reports: dict[int, tuple[Report, ...]] = field(default_factory=dict)
    """Those that arrived in each step, by step; empty where none did."""
    scenario: str = ""
    """The effective scenario, as TOML."""
    metadata: dict[str, str] = field(default_factory=dict)
    """The manifest; empty if the recording was never closed."""
    complete: bool = False
    """Whether the recording was closed with its manifest, and nothing of it is missing."""


def read_recording(path: Path) -> Recording:
    """The recording in a file, or in a run's folder, whether it was finished or cut off anywhere.

    Raises:
        FileNotFoundError: there is none.
        RecordingError: the file is no MCAP file.
    """
    if path.is_dir():
        whole = path / RECORDING
        path = whole if whole.exists() else whole.with_name(RECORDING + PART)
    reader = _Reader()
    for record in records(path):
        if record is None:
            return reader.recording(is_whole=False)
        reader.take(record)
    return reader.recording(is_whole=True)


class _Reader:
    """Collects figures, record by record."""

    def __init__(self) -> None:
        self._found = Recording()
        self._topics: dict[int, str] = {}
        self._events: dict[int, EventState] = {}
        self._net: dict[int, Mapping[str, Any]] = {}
        self._state: dict[int, Mapping[str, Any]] = {}

    def take(self, record: McapRecord) -> None:
        if isinstance(record, Message):
            self._take_message(self._topics[record.channel_id], record.data)
        elif isinstance(record, Channel):
            self._topics[record.id] = record.topic
        elif isinstance(record, Attachment) and record.name == SCENARIO_ATTACHMENT:
            self._found.scenario = record.data.decode()
        elif isinstance(record, Metadata) and record.name == MANIFEST:
            self._found.metadata = dict(record.metadata)
            self._found.complete = True

    def _take_message(self, topic: str, data: bytes) -> None:
        match topic:
            case "/net/stats":
                net = orjson.loads(data)
                self._net[net["step"]] = net
            case "/swarm/state":
                state = orjson.loads(data)
                self._state[state["step"]] = state
            case "/swarm/event":
                event: EventState = row_of(EventState, orjson.loads(data))
                self._events[event.event] = event
            case "/operator/inbox":
                inbox = orjson.loads(data)
                self._found.reports[inbox["step"]] = tuple(_report(report) for report in inbox["reports"])
            case "/operator/workload":
                self._found.workloads.append(row_of(Workload, orjson.loads(data)))

    def recording(self, is_whole: bool) -> Recording:
        """All that was found; of a damaged file, up to the first step that is missing or broken."""
        found = self._found
        found.complete &= is_whole
        found.events = sorted(self._events.values(), key=lambda event: (event.arrived_s, event.event))
        steps = sorted(self._net.keys() & self._state)
        if not found.complete:  # damage can hide a chunk as a whole
            steps = [step for place, step in enumerate(steps) if step == steps[0] + place]
        found.tallies = [row_of(Tally, {**self._net[step], **self._state[step]}) for step in steps]
        return found


def _report(values: Mapping[str, Any]) -> Report:
    events = tuple(row_of(Event, event) for event in values["events"])
    return Report(**{**values, "events": events})
