"""Rerun opens a recording and draws the swarm: what it decodes by itself, without a viewer."""

from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import McapReader

from deltaswarm_orchestrator.recording.scene import ROLE_COLOURS
from deltaswarm_orchestrator.recording.schemas import TOPICS
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from tests.support.truths import recorded, steps

STEPS = 20
SCENARIO = load(Scenario, {"agents": {"count": 12}})


def decoded(path: Path, **options: Any) -> dict[str, list[pa.RecordBatch]]:
    """What Rerun makes of a file over time, by entity."""
    found: dict[str, list[pa.RecordBatch]] = {}
    for chunk in McapReader(path, **options).stream().to_chunks():
        if "message_log_time" in (batch := chunk.to_record_batch()).schema.names:
            found.setdefault(chunk.entity_path, []).append(batch)
    return found


def column(batches: list[pa.RecordBatch], name: str) -> list[Any]:
    return [value for batch in batches for value in batch.column(name).to_pylist()]


def test_rerun_draws_agents_and_events(tmp_path: Path) -> None:
    """As points in the arena's frame, which it can place in the world; each agent in its role's colour."""
    found = decoded(recorded(tmp_path, SCENARIO, STEPS))
    assert found.keys() == set(TOPICS)
    places = column(found["/points/agents"], "Points3D:positions")
    assert [len(of_step) for of_step in places] == [12] * STEPS
    first = next(steps(SCENARIO, 1))[0].bodies
    assert all(
        abs(x - body.x_m) < 0.001 and abs(y - body.y_m) < 0.001
        for (x, y, _), body in zip(places[0], first, strict=True)
    )
    colours = column(found["/points/agents"], "Points3D:colors")[0]
    assert [f"#{rgba >> 8:06x}" for rgba in colours] == [ROLE_COLOURS[body.role] for body in first]
    assert set(column(found["/points/agents"], "CoordinateFrame:frame")[0]) == {"arena"}
    assert all(column(found["/points/events"], "Points3D:positions"))
    children = column(found["/tf"], "Transform3D:child_frame")
    assert children == [[name] for name in ("arena", *(f"agent/{i}" for i in range(12)))] * STEPS
