"""The layout: what Foxglove and Lichtblick show of a recording."""

import json

import pytest

from deltaswarm_orchestrator.recording.recorder import layout
from deltaswarm_orchestrator.recording.schemas import ARENA_FRAME, FIGURE_TOPICS, ROOT_FRAME, SCENE_TOPICS


@pytest.mark.parametrize("size", [(100.0, 100.0), (1000.0, 20.0), (5.0, 30.0)])
def test_the_layout_shows_the_whole_arena(size: tuple[float, float]) -> None:
    """Every scene topic is on, the camera above the centre sees the longest side, and all panels are placed."""
    shown = layout(*size)
    scene = shown["configById"]["3D!arena"]
    assert {topic for topic in scene["topics"] if scene["topics"][topic]["visible"]} == {*SCENE_TOPICS}
    assert (scene["followTf"], scene["transforms"].keys()) == (
        ROOT_FRAME,
        {f"frame:{ROOT_FRAME}", f"frame:{ARENA_FRAME}"},
    )
    camera = scene["cameraState"]
    seen_m = 2 * camera["distance"] * 0.41421  # twice the tangent of half of 45 degrees
    assert max(size) < seen_m < 1.5 * max(size)
    assert camera["far"] > camera["distance"]
    text = json.dumps(shown["layout"])
    assert all(panel in text for panel in shown["configById"])


def test_the_layout_plots_what_is_recorded() -> None:
    """Each plotted path is a field of the message of its topic."""
    for panel, settings in layout(100.0, 100.0)["configById"].items():
        for path in settings["paths"] if panel.startswith("Plot!") else ():
            topic, name = path["value"].split(".")
            assert name in FIGURE_TOPICS[topic].DESCRIPTOR.fields_by_name
