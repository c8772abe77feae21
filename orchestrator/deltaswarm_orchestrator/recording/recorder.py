"""Record a run as MCAP while it is in progress.

This module does file input and output only: `transcriber.py` makes the messages, and the caller has the run's clock
and connection.
"""

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any, Self

import orjson
from mcap.records import Channel, Message
from mcap_protobuf.schema import register_schema

from deltaswarm_orchestrator.base.disk import RoomError, no_room, room_for
from deltaswarm_orchestrator.recording import LAYOUT, MANIFEST, PART, RECORDING, SCENARIO, WIRE
from deltaswarm_orchestrator.recording.finishing import new_writer
from deltaswarm_orchestrator.recording.reader import RecordingError, records, row_of, values_of
from deltaswarm_orchestrator.recording.scene import log_time_ns
from deltaswarm_orchestrator.recording.schemas import OURS, TOPICS
from deltaswarm_orchestrator.recording.sink import Viewer
from deltaswarm_orchestrator.recording.transcriber import (
    TopicMessage,
    Transcriber,
    log_message,
    steps_between_views,
    workload_message,
)
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import EventState, Truth
from deltaswarm_wire.operator_messages import Report, Workload

FLUSH_EVERY_S = 1.0
"""Wall time between flushes [s]; a kill loses at most what came within this time."""


TEMPLATE = Path(__file__).with_name("layout_template.json")
"""A layout as viewers export it, without what depends on the arena's size.

Its background is white because events are black. Frames are hidden only one by one, since viewers draw no line to a
frame whose parent is hidden.
"""


class Recorder:
    """Writes `recording.mcap` into `folder` and, with `wire`, the raw frames into `wire.mcap`.

    Until `complete`, the names of the files end in `.part`. Leaving the context without it keeps these names: the files
    can be read, but count as incomplete.

    Args:
        folder: the run's folder, which must exist.
        scenario: the effective scenario, kept as TOML.
        wire: whether raw frames are kept.
        wall: a wall clock [s].
        viewer: is given the same messages while the run is under way.
    """

    def __init__(
        self,
        folder: Path,
        scenario: Scenario,
        wire: bool = False,
        wall: Callable[[], float] = time.monotonic,
        viewer: Viewer | None = None,
    ) -> None:
        self._wall = wall
        self._started_s = self._flushed_s = wall()
        self._viewer = viewer
        self._transcriber = Transcriber(scenario)
        self._view_every = steps_between_views(scenario.run.step_s)
        self._step_s = scenario.run.step_s
        self._steps = 0
        self._step = 0
        self._time_s = 0.0

        shown = layout_json(scenario.arena.width_m, scenario.arena.height_m)
        (folder / LAYOUT).write_bytes(shown)
        self._file = _File(folder / RECORDING)
        self._wire = _File(folder / WIRE) if wire else None
        self._files = [file for file in (self._file, self._wire) if file is not None]
        self._file.attach(SCENARIO, "application/toml", to_toml(scenario).encode())
        self._file.attach(LAYOUT, "application/json", shown)
        for topic in TOPICS:  # announced even if it gets no messages
            self._file.channel(topic)
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._finish(None)

    def continue_from(self, before: Mapping[str, Path], step: int) -> list[str]:
        """Begin with the messages of earlier recordings up to a step; return what is lost of them, one line each.

        `before` maps the name of each new file to the earlier file that it continues.
        """
        self._step, self._time_s, self._steps = step, step * self._step_s, step + 1
        lost = []
        for file in self._files:
            newest = self._copy(file, before[file.name]) if file.name in before else -1
            if file is self._file and newest < step:
                lost.append(
                    f"{file.name} has lost steps {newest + 1} to {step}: it was damaged before the run was resumed"
                )
        self.save()
        return lost

    def _copy(self, file: "_File", before: Path) -> int:
        """Add the messages of an earlier file as far as it can be read; return its newest step, or -1."""
        newest = -1
        with suppress(RecordingError):
            for topic, step, data in file.copy(before, log_time_ns(self._time_s)):
                newest = max(newest, step)
                if topic == "/swarm/event":
                    self._transcriber.note(row_of(EventState, values_of(OURS["Event"].FromString(data))))
        return newest

    def save(self) -> None:
        """Write everything so far to disk, so that it survives a crash of the machine."""
        for file in self._files:
            file.save()

    def step(self, truth: Truth, reports: Sequence[Report]) -> None:
        """Record a closed step: its truth, and the reports that reached the operator in it."""
        self._step, self._time_s = truth.step, truth.time_s
        transcriber = self._transcriber
        self._write(transcriber.figures(truth, reports, round(self._wall() - self._started_s, 3)), *truth[:2])
        self._write(transcriber.events(truth.events), *truth[:2])
        if self._steps % self._view_every == 0:
            self._write(transcriber.views(truth), *truth[:2])
        self._steps += 1
        self._end_of_step()

    def workload(self, workload: Workload) -> None:
        self._write([("/operator/workload", workload_message(workload))], workload.step, workload.time_s)
        self._end_of_step()

    def log(self, level: int, name: str, text: str, time_s: float) -> None:
        """Record a line of a part's log; `level` is that of Python's logging, `time_s` is simulated [s]."""
        self._write([("/log", log_message(level, name, text, time_s))], self._step, time_s)
        self._end_of_step()

    def radio(self, step: int, agent: int, data: bytes) -> None:
        """Record a radio frame as its sender made it, if `wire` is on."""
        if self._wire:
            self._wire.write(f"/agent/{agent}/radio", step, step * self._step_s, data)

    def report_bytes(self, step: int, agent: int, data: bytes) -> None:
        """Record a report as its sender made it, if `wire` is on."""
        if self._wire:
            self._wire.write(f"/agent/{agent}/report", step, step * self._step_s, data)

    def flush_when_due(self) -> None:
        """Flush if FLUSH_EVERY_S has passed since the last flush. Every step and log line calls this."""
        now_s = self._wall()
        if now_s - self._flushed_s >= FLUSH_EVERY_S:
            self._flushed_s = now_s
            for file in self._files:
                file.flush()

    def complete(self, manifest: Mapping[str, Any], tables: Iterable[tuple[str, bytes]] = ()) -> None:
        """Add the manifest and tables (name, CSV), finish the files, and give them their final names.

        Values of the manifest that are not text become JSON.
        """
        for name, data in tables:
            self._file.attach(name, "text/csv", data)
        self._finish(
            {name: text if isinstance(text, str) else orjson.dumps(text).decode() for name, text in manifest.items()}
        )

    def _write(self, messages: Iterable[TopicMessage], step: int, time_s: float) -> None:
        write, viewer = self._file.write, self._viewer
        for topic, data in messages:
            write(topic, step, time_s, data)
            if viewer is not None:
                viewer.put(topic, time_s, data)

    def _end_of_step(self) -> None:
        self.flush_when_due()
        if self._viewer is not None:
            self._viewer.tick()

    def _finish(self, manifest: dict[str, str] | None) -> None:
        """Finish the files, complete or not; a full disk is no error of an incomplete file."""
        if self._file.is_finished:
            return
        with suppress(RoomError) if manifest is None else nullcontext():
            self._write(self._transcriber.open_events(), self._step, self._time_s)
        for file in self._files:
            with suppress(RoomError) if manifest is None else nullcontext():
                file.finish(manifest)


class _File:
    def __init__(self, path: Path) -> None:
        self.is_finished = False
        self.name = path.name
        self._path = path
        self._part = path.with_name(path.name + PART)
        self._stream = self._part.open("wb")
        self._writer: Any = new_writer(self._stream)
        self._channels: dict[str, int] = {}
        self._schemas: dict[Any, int] = {}

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        self._writer.add_attachment(0, log_time_ns(0.0), name, media_type, data)

    def channel(self, topic: str) -> int:
        """Return the channel of a topic, registering it at first use; raw bytes have no schema."""
        if topic not in self._channels:
            kind = TOPICS.get(topic)
            if kind and kind not in self._schemas:
                self._schemas[kind] = register_schema(self._writer, kind)
            encoding = "protobuf" if kind else "msgpack"
            self._channels[topic] = self._writer.register_channel(topic, encoding, self._schemas.get(kind, 0))
        return self._channels[topic]

    def write(self, topic: str, step: int, time_s: float, data: bytes) -> None:
        self._add(topic, log_time_ns(time_s), step, data)

    def _add(self, topic: str, now_ns: int, step: int, data: bytes) -> None:
        try:
            self._writer.add_message(self.channel(topic), now_ns, data, now_ns, step)
        except OSError as error:
            raise no_room(error, self._part) from None

    def copy(self, before: Path, until_ns: int) -> Iterator[tuple[str, int, bytes]]:
        """Add the messages of another file up to a time; yield topic, step and data of each."""
        topics: dict[int, str] = {}
        for record in records(before):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and record.log_time <= until_ns:
                topic = topics[record.channel_id]
                self._add(topic, record.log_time, record.sequence, record.data)
                yield topic, record.sequence, record.data

    def flush(self) -> None:
        with room_for(self._part):
            self._writer.flush()

    def save(self) -> None:
        self.flush()
        with room_for(self._part):
            os.fsync(self._stream.fileno())

    def finish(self, manifest: dict[str, str] | None) -> None:
        """Finish the file; with a manifest, it is complete and gets its final name."""
        self.is_finished = True
        with room_for(self._part), self._stream:
            if manifest is not None:
                self._writer.flush()  # the manifest comes after the messages
                self._writer.add_metadata(MANIFEST, manifest)
            self._writer.finish()
        if manifest is not None:
            self._part.replace(self._path)


def layout_json(width_m: float, height_m: float) -> bytes:
    return orjson.dumps(layout(width_m, height_m), option=orjson.OPT_INDENT_2)


def layout(width_m: float, height_m: float) -> dict[str, Any]:
    """Make a viewer's layout, with the camera far enough away to show the whole arena."""
    longest_m = max(width_m, height_m)
    distance_m = 1.4 * longest_m  # at 45 degrees of view this shows 1.16 times the longest side
    filled: dict[str, Any] = orjson.loads(TEMPLATE.read_bytes())
    scene = filled["configById"]["3D!arena"]
    scene["cameraState"] |= {"distance": distance_m, "far": max(5000, 4 * distance_m)}
    scene["scene"]["transforms"] = {"labelSize": longest_m / 80, "axisScale": longest_m / 100}
    scene["layers"]["grid"]["size"] = longest_m
    return filled
