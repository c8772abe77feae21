"""Turn a run's steps into the protobuf messages of a recording, once for the file and for live viewers.

This module writes nothing: each message is a topic and its bytes, and the caller decides where they go.
"""

import math
from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log

from deltaswarm_orchestrator.recording.scene import Scene, stamp
from deltaswarm_orchestrator.recording.schemas import NET_FIELDS, OURS, STATE_FIELDS, TOPICS
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import DROP_REASONS, EventState, Truth
from deltaswarm_wire.operator_messages import Report, Workload

VIEW_RATE_HZ = 10.0
"""Most view messages per topic and second of playback."""

TopicMessage = tuple[str, bytes]
"""A topic, and one message for it, encoded."""

_times = attrgetter("sensed_s", "worked_s", "completed_s")


class Transcriber:
    """Makes the messages of a run's steps, in the order in which a recording holds them.

    Views and events depend on earlier steps, so each step is transcribed once.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scene = Scene(scenario)
        self._open_events: dict[int, EventState] = {}

    def figures(self, truth: Truth, reports: Sequence[Report], wall_s: float) -> Iterator[TopicMessage]:
        """Yield the numbers of a step, without its events; `wall_s` is the run's wall time [s]."""
        record = truth.step_record.columns()
        head = {"step": truth.step, "time_s": truth.time_s}
        drops = {name: count for name, count in truth.step_record.frames_dropped.items() if name not in DROP_REASONS}
        others = [OURS["Drops"](reason=reason, frames=count) for reason, count in drops.items()]
        net = {name: record[name] for name in NET_FIELDS if record[name]}  # absent is 0
        yield _encoded("/net/stats", head | net | {"other_drops": others})
        yield _encoded("/swarm/state", head | {name: record[name] for name in STATE_FIELDS} | {"wall_s": wall_s})
        inbox = OURS["Inbox"](step=truth.step, time_s=truth.time_s, count=len(reports))
        for report in reports:
            _fill(inbox.reports.add(), report)
        yield "/operator/inbox", inbox.SerializeToString()

    def events(self, events: Sequence[EventState]) -> Iterator[TopicMessage]:
        """Yield the events that arrived, were first sensed, were first worked on or were completed in this step."""
        for event in events:
            before = self._open_events.get(event.event)
            if before is None or _times(before) != _times(event):
                yield _event(event)
            self.note(event)

    def views(self, truth: Truth) -> Iterator[TopicMessage]:
        return self._scene.messages(truth)

    def open_events(self) -> list[TopicMessage]:
        """Return the incomplete events again, with the work done since, for the end of a recording."""
        return [_event(event) for event in self._open_events.values()]

    def note(self, event: EventState) -> None:
        """Remember the state of an event; forget the event if it is complete."""
        if event.completed_s is None:
            self._open_events[event.event] = event
        else:
            self._open_events.pop(event.event, None)


def workload_message(workload: Workload) -> bytes:
    """Encode what the operator counted in one step, for `/operator/workload`."""
    return bytes(OURS["Workload"](**workload._asdict()).SerializeToString())


def log_message(level: int, name: str, text: str, time_s: float) -> bytes:
    """Encode a line of a part's log, for `/log`; `level` is that of Python's logging, `time_s` is simulated [s]."""
    line = text.encode(errors="replace").decode()  # protobuf refuses what UTF-8 cannot encode
    message = Log(timestamp=stamp(time_s), level=min(5, max(0, level // 10)), message=line, name=name)
    return bytes(message.SerializeToString())


def steps_between_views(step_s: float) -> int:
    """Return the number of steps per view: 1, unless that made more views per second than VIEW_RATE_HZ."""
    return max(1, math.ceil(1 / (VIEW_RATE_HZ * step_s) - 1e-9))


def _encoded(topic: str, fields: dict[str, Any]) -> TopicMessage:
    return topic, TOPICS[topic](**fields).SerializeToString()


def _event(event: EventState) -> TopicMessage:
    return _encoded("/swarm/event", event._asdict())


def _fill(message: Any, report: Report) -> None:
    """Copy a report field by field, which is several times as fast as making a message from a dict."""
    message.agent, message.sequence, message.step, message.role = report[:4]
    message.x_m, message.y_m, message.followers = report[4:7]
    message.delta = report.delta
    for event in report.events:
        sighting = message.events.add()
        sighting.event, sighting.x_m, sighting.y_m = event
    for row in report.members:
        member = message.members.add()
        member.agent, member.parent, member.x_cm, member.y_cm = row
    for number, state in report.answers:
        answer = message.answers.add()
        answer.command, answer.state = number, state
