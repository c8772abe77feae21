"""Export a Rerun recording: agents as points per role, trees, events, walls, and metrics as plots.

Rerun also opens `recording.mcap` directly; this export adds separate roles, trees and plots.
"""

from pathlib import Path
from typing import Any

import rerun as rr

from deltaswarm_orchestrator.export.snapshots import Film, Snapshot
from deltaswarm_orchestrator.recording.scene import EVENT_RGBA, role_rgba
from deltaswarm_scenario.truth import AgentState

TIME, STEP = "time", "step"
"""The timelines: simulated time, and steps."""

AGENT_RADIUS, EVENT_RADIUS = 0.007, 0.009
"""Radii as shares of the arena's longest side."""

SWARM = ("agents_in_trees", "trees", "events_open")
WORKLOAD = ("messages", "rate_60s_hz")


def write(film: Film, out: Path) -> None:
    longest_m = max(film.width_m, film.height_m)
    with rr.RecordingStream("deltaswarm", recording_id=film.recording.metadata.get("digest")) as stream:
        stream.save(out)
        stream.log("arena", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log("arena/walls", rr.LineStrips3D([_flat(wall) for wall in film.walls_m]), static=True)
        shown: set[str] = set()
        for view in film.snapshots():
            shown = _log(stream, view, shown, longest_m, film.radius_m)
        for entity, names, rows in (
            ("swarm", SWARM, film.recording.step_records),
            ("operator", WORKLOAD, film.recording.workloads),
        ):
            times = [
                rr.TimeColumn(TIME, duration=[row.time_s for row in rows]),
                rr.TimeColumn(STEP, sequence=[row.step for row in rows]),
            ]
            for name in names if rows else ():
                values = [float(getattr(row, name)) for row in rows]
                stream.send_columns(f"{entity}/{name}", times, rr.Scalars.columns(scalars=values))


def _log(stream: Any, view: Snapshot, shown: set[str], longest_m: float, radius_m: float) -> set[str]:
    """Log one view; return its roles."""
    stream.set_time(TIME, duration=view.time_s)
    stream.set_time(STEP, sequence=view.step)
    roles = {body.role for body in view.bodies}
    for role in sorted(roles | shown):  # log no points once, after the last agent left
        bodies = [body for body in view.bodies if body.role == role]
        points = rr.Points3D(
            [_place_m(body) for body in bodies],
            colors=[list(role_rgba(role))] * len(bodies),
            radii=[radius_m or AGENT_RADIUS * longest_m] * len(bodies),
        )
        stream.log(f"arena/agents/{rr.escape_entity_path_part(role)}", points)
    lines = [[_place_m(body) for body in pair] for pair in view.trees]
    stream.log("arena/trees", rr.LineStrips3D(lines, colors=[list(role_rgba("member"))] * len(lines)))
    count = len(view.events)
    events = _flat([(event.x_m, event.y_m) for event in view.events])
    colours, radii = [list(EVENT_RGBA)] * count, [EVENT_RADIUS * longest_m] * count
    stream.log("arena/events", rr.Points3D(events, colors=colours, radii=radii))
    return roles


def _place_m(body: AgentState) -> tuple[float, float, float]:
    return body.x_m, body.y_m, body.height_m or 0.0


def _flat(places: list[tuple[float, float]]) -> list[tuple[float, float, float]]:
    return [(x, y, 0.0) for x, y in places]
