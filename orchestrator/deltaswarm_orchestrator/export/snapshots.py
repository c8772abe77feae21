"""Read the views and metrics that an export shows of a recording, and export them as CSV."""

import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_orchestrator.recording.reader import (
    Recording,
    RecordingError,
    entries,
    read_recording,
    row_of,
    values_of,
)
from deltaswarm_orchestrator.recording.schemas import AGENT_FIELDS
from deltaswarm_orchestrator.results.outcome import EventLife, Outcome
from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_scenario.truth import BODY_FIELDS, AgentState, EventState
from deltaswarm_wire.messages import NOBODY
from deltaswarm_wire.operator_messages import Workload

Line = list[tuple[float, float]]


class Snapshot(NamedTuple):
    """The swarm in one step: its agents, and the events that have arrived and are not complete."""

    step: int
    time_s: float
    bodies: tuple[AgentState, ...]
    events: tuple[EventState, ...]

    @property
    def trees(self) -> list[tuple[AgentState, AgentState]]:
        """Each child and its parent."""
        bodies = {body.agent: body for body in self.bodies}
        return [(body, bodies[body.parent]) for body in self.bodies if body.parent in bodies]

    def headings_m(self, radius_m: float) -> list[Line]:
        """A line from the centre of each body that has a heading to its edge."""
        return [
            [(body.x_m, body.y_m), (body.x_m + radius_m * math.cos(angle), body.y_m + radius_m * math.sin(angle))]
            for body in self.bodies
            if (angle := body.heading_rad) is not None
        ]


@dataclass(frozen=True)
class Film:
    """A recording to export."""

    path: Path
    recording: Recording
    width_m: float
    height_m: float
    walls_m: list[Line]
    """The edges of the arena and of the obstacles, as closed lines."""
    radius_m: float = 0.0
    """The radius of a body; 0: a point."""

    def snapshots(self) -> Iterator[Snapshot]:
        """Yield each view, as far as the file can be read.

        A view is complete when the next one begins: the agents' statuses follow the frames if one of them changed.
        """
        events: dict[int, EventState] = {}
        step, time_s = 0, 0.0
        view: Snapshot | None = None
        statuses: list[dict[str, Any]] = []
        for topic, message in entries(self.path, {"/swarm/state", "/swarm/event", "/tf", "/swarm/agents"}):
            match topic:
                case "/swarm/state":
                    step, time_s = message.step, message.time_s
                case "/swarm/event":
                    event = row_of(EventState, values_of(message))
                    events[event.event] = event
                    if event.completed_s is not None:
                        del events[event.event]
                case "/swarm/agents":
                    shown = [*AGENT_FIELDS, *BODY_FIELDS] if message.heading_rad else AGENT_FIELDS
                    rows = zip(*(getattr(message, name) for name in shown), strict=True)
                    statuses = [dict(zip(shown, row, strict=True)) for row in rows]
                case "/tf":
                    if view is not None:
                        yield _with_statuses(view, statuses)
                    _, *frames = message.transforms
                    place = _in_the_air if any(frame.translation.z for frame in frames) else _on_the_ground
                    view = Snapshot(step, time_s, tuple(map(place, frames)), tuple(events.values()))
        if view is not None:
            yield _with_statuses(view, statuses)


def read_film(path: Path) -> Film:
    """Open the recording in a file."""
    recording = read_recording(path)
    if not recording.scenario:
        raise RecordingError(f"{path} must hold a scenario; it is damaged or was cut off before that")
    try:
        scenario = tomllib.loads(recording.scenario)
        arena = scenario["arena"]
    except (tomllib.TOMLDecodeError, KeyError) as error:
        raise RecordingError(f"{path} must hold a valid scenario: {error}") from None
    width_m, height_m = arena["width_m"], arena["height_m"]
    obstacles = [[(x, y) for x, y in obstacle["corners_m"]] for obstacle in arena.get("obstacles", [])]
    loops = [[(0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m)], *obstacles]
    radius_m = float(scenario.get("world", {}).get("radius_m", 0.0))
    return Film(path, recording, width_m, height_m, [[*loop, loop[0]] for loop in loops], radius_m)


def _on_the_ground(frame: Any) -> AgentState:
    return AgentState(0, frame.translation.x, frame.translation.y, "", 0, 0)


def _in_the_air(frame: Any) -> AgentState:
    x, y, z, w = (getattr(frame.rotation, name) for name in "xyzw")
    return _on_the_ground(frame)._replace(
        height_m=frame.translation.z,
        roll_rad=math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        pitch_rad=math.asin(min(max(2 * (z * x - w * y), -1.0), 1.0)),
    )


def _with_statuses(view: Snapshot, statuses: list[dict[str, Any]]) -> Snapshot:
    """Add to each body of a view what it says it is; drop all bodies if the file was cut off in between."""
    if len(statuses) != len(view.bodies):
        return view._replace(bodies=())
    pairs = zip(view.bodies, statuses, strict=True)
    bodies = (body._replace(**status) for body, status in pairs)
    return view._replace(bodies=tuple(bodies))


def write(film: Film, out: Path) -> None:
    """Write `poses.csv` (a row per view and agent), `events.csv` (per event) and `workload.csv` (per step).

    A cell is empty where there is no time yet, no parent, no root, or a body has no such state.
    """
    out.mkdir()
    poses = (
        (
            view.step,
            view.time_s,
            *("" if value is None or (value == NOBODY and type(value) is int) else value for value in body),
        )
        for view in film.snapshots()
        for body in view.bodies
    )
    write_csv(out / "poses.csv", ("step", "time_s", *AgentState._fields), poses)
    outcome = Outcome(events=film.recording.events, told_s=film.recording.told_s)
    write_csv(out / "events.csv", EventLife._fields, outcome.lives)
    write_csv(out / "workload.csv", Workload._fields, film.recording.workloads)
