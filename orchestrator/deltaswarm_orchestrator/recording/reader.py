"""Read a recording back, complete or cut off anywhere: its records, and the numbers exactly as they were written.

The recording of a killed run holds what had been flushed.
"""

import json
import os
import struct
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from google.protobuf.message import DecodeError
from mcap.data_stream import RecordBuilder
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory
from zstandard import ZstdError

from deltaswarm_orchestrator import recording as names
from deltaswarm_orchestrator.base import seal
from deltaswarm_scenario.truth import EventState, StepRecord
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import Answer, Report, ReportedMember, Workload

_MAGIC = b"\x89MCAP0\r\n"

_DAMAGE = (McapError, ZstdError, struct.error, ValueError, OverflowError, MemoryError)
"""The exceptions that reading a truncated or damaged file can raise."""

DAMAGED = "damaged"
"""The name of the last entry of a damaged or cut-off file."""

FIGURES = frozenset({"/net/stats", "/swarm/state", "/swarm/event", "/operator/inbox", "/operator/workload"})
"""The topics with the numbers of a run."""

NEWER = ("worked_s",)
"""Fields that recordings of earlier versions may lack: None."""


@dataclass(frozen=True)
class Damage:
    """Stands for everything from the first record on that cannot be read."""

    is_at_the_end: bool
    """Whether the file merely ends too early."""


class RecordingError(ValueError):
    """The file is not a usable recording."""


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

    @property
    def told_s(self) -> dict[int, float]:
        """By event, when the first report that names it had arrived at the operator [s]."""
        told_s: dict[int, float] = {}
        for record in self.step_records:
            for report in self.reports.get(record.step, ()):
                told_s |= {event: record.time_s for event, _, _ in report.events if event not in told_s}
        return told_s


def recording_in(path: Path) -> Path:
    """Return the file itself, or the recording in a run's folder: the finished one, else the partial one."""
    if not path.is_dir():
        return path
    complete = path / names.RECORDING
    return complete if complete.exists() else complete.with_name(names.RECORDING + names.PART)


def read_recording(path: Path) -> Recording:
    """Read the recording in a file or in a run's folder, whether it was finished or cut off.

    The step records of an incomplete recording end before the first missing step, since damage can hide a whole chunk.

    Raises:
        FileNotFoundError: there is no recording.
        RecordingError: the file is not an MCAP file, or is of another run than the folder that holds it.
    """
    path = recording_in(path)
    recording = Recording()
    events: dict[int, EventState] = {}
    net: dict[int, dict[str, Any]] = {}
    state: dict[int, dict[str, Any]] = {}
    for name, content in entries(path, FIGURES | {names.SCENARIO, names.MANIFEST}):
        match name:
            case "/net/stats":
                others = {f"dropped_{drops.reason}": drops.frames for drops in getattr(content, "other_drops", ())}
                net[content.step] = values_of(content) | others
            case "/swarm/state":
                state[content.step] = values_of(content)
            case "/swarm/event":
                events[content.event] = row_of(EventState, values_of(content))
            case "/operator/inbox":
                recording.reports[content.step] = tuple(_report(report) for report in content.reports)
            case "/operator/workload":
                recording.workloads.append(row_of(Workload, values_of(content)))
            case names.SCENARIO:
                check_origin(path, name, content)
                recording.scenario = content.decode()
            case names.MANIFEST:
                check_origin(path, name, content)
                recording.metadata, recording.complete = dict(content), True
            case _:
                recording.complete = False
    recording.events = sorted(events.values(), key=lambda event: (event.arrived_s, event.event))
    steps = sorted(net.keys() & state)
    if not recording.complete:
        steps = [step for place, step in enumerate(steps) if step == steps[0] + place]
    recording.step_records = [StepRecord.of({**net[step], **state[step]}) for step in steps]
    return recording


def check_origin(file: Path, name: str, content: bytes | Mapping[str, str]) -> None:
    """Check the scenario or the manifest in a recording against the folder that holds the file, if that is a run's."""
    folder = file.parent
    manifest = seal.read_sealed(folder / seal.MANIFEST)
    if not manifest or "swept" in manifest:
        return
    if isinstance(content, bytes):
        beside = folder / name
        differing = [name] if beside.exists() and beside.read_bytes() != content else []
    else:
        keys = ("name", "seed", "started", "digest")
        differing = [key for key in keys if content.get(key) != _text(manifest.get(key))]
    if differing:
        raise RecordingError(
            f"{file} must be the recording of the run in {folder} ({', '.join(differing)} differ); "
            "restore it, or move it to a folder of its own"
        )


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def entries(path: Path, wanted: Container[str]) -> Iterator[tuple[str, Any]]:
    """Yield name and content of each wanted entry: a topic's message, an attachment's bytes, or metadata.

    Messages are decoded by the schema that the file itself holds. A damaged or cut-off file ends with DAMAGED.
    """
    factory = DecoderFactory()
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, Callable[[bytes], Any]]] = {}
    for record in records(path):
        match record:
            case Message() if record.channel_id in channels:
                topic, decode = channels[record.channel_id]
                try:
                    message = decode(record.data)
                except DecodeError:
                    yield DAMAGED, None
                    return
                yield topic, message
            case Schema():
                schemas[record.id] = record
            case Channel() if record.topic in wanted:
                decoder = factory.decoder_for(record.message_encoding, schemas.get(record.schema_id))
                if decoder is None:
                    raise RecordingError(f"{record.topic} must be in protobuf (got {record.message_encoding})")
                channels[record.id] = record.topic, decoder
            case Attachment() if record.name in wanted:
                yield record.name, record.data
            case Metadata() if record.name in wanted:
                yield record.name, record.metadata
            case Damage():
                yield DAMAGED, None


def records(path: Path) -> Iterator[McapRecord | Damage]:
    """Yield each record up to the end of the file, or up to the first damage, and then that."""
    size_bytes = path.stat().st_size
    with path.open("rb") as stream:
        if not _MAGIC.startswith(stream.read(len(_MAGIC))):
            raise RecordingError(f"{path} is not an MCAP file")
        stream.seek(0)
        remaining = StreamReader(stream, validate_crcs=True, record_size_limit=size_bytes).records
        while True:
            try:
                record = next(remaining, None)
            except _DAMAGE as error:
                yield Damage(is_at_the_end=isinstance(error, EndOfFile))
                return
            if record is None:
                return
            if isinstance(record, Attachment) and not _is_intact(record, stream):
                yield Damage(is_at_the_end=False)
                return
            yield record


def _is_intact(attachment: Attachment, stream: BinaryIO) -> bool:
    """Return whether an attachment has the checksum before the stream's position, which the library does not check."""
    stream.seek(-4, os.SEEK_CUR)
    checksum = int.from_bytes(stream.read(4), "little")
    written = RecordBuilder()
    attachment.write(written)
    return checksum in (0, int.from_bytes(written.end()[-4:], "little"))  # type: ignore[no-untyped-call]


def values_of(message: Any) -> dict[str, Any]:
    """Return the fields of a message by name; None for absent fields."""
    return {
        field.name: None if field.has_presence and not message.HasField(field.name) else getattr(message, field.name)
        for field in message.DESCRIPTOR.fields
    }


def row_of(kind: Any, values: Mapping[str, Any]) -> Any:
    """Make a named tuple of the wire from the values of its fields; recordings of before may lack `NEWER`."""
    return kind(*[values[name] if name in values or name not in NEWER else None for name in kind._fields])


def _report(message: Any) -> Report:
    kinds = {"events": Event, "members": ReportedMember, "answers": Answer}
    rows = {name: tuple(row_of(kind, values_of(row)) for row in getattr(message, name)) for name, kind in kinds.items()}
    return Report(**{**values_of(message), **rows})
