"""Rerun opens a recording and draws the swarm: what it decodes by itself, without a viewer."""

from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import McapReader

from deltaswarm_orchestrator.recording.recorder import Recorder
from deltaswarm_orchestrator.recording.scene import ROLE_COLOURS
from deltaswarm_orchestrator.recording.schemas import SCENE_TOPICS, TOPICS
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


def test_rerun_shows_the_log_and_our_own_figures(tmp_path: Path) -> None:
    """Lines of log as text; every field of our messages, absent where it is not yet."""
    found = decoded(recorded(tmp_path, SCENARIO, STEPS))
    assert column(found["/log"], "TextLog:text") == [[f"step {step}"] for step in range(STEPS)]
    assert set(column(found["/log"], "TextLog:level")[0]) == {"INFO"}
    told = list(steps(SCENARIO, STEPS))
    workloads = [row for (row,) in column(found["/operator/workload"], "deltaswarm.Workload:message")]
    assert workloads == [workload._asdict() for _, _, workload in told]
    states = [row for (row,) in column(found["/swarm/state"], "deltaswarm.SwarmState:message")]
    assert [row["covered_area_m2"] for row in states] == [truth.step_record.covered_area_m2 for truth, _, _ in told]


def test_rerun_recovers_a_recording_that_was_cut_off(tmp_path: Path) -> None:
    """All that was flushed, with the option that it has for such files."""
    with Recorder(tmp_path, SCENARIO) as recorder:
        for truth, reports, _ in steps(SCENARIO, STEPS):
            recorder.step(truth, reports)
        recorder.save()
        whole = (tmp_path / "recording.mcap.part").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole)
    found = decoded(tmp_path / "cut.mcap", recover=True)
    assert found.keys() >= {"/tf", "/points/agents", *SCENE_TOPICS}
    assert len(column(found["/points/agents"], "Points3D:positions")) == STEPS
