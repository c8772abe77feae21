"""The layout for Foxglove and Lichtblick: the scene from above, workload, trees, log."""

from collections.abc import Iterable
from typing import Any

import orjson

from deltaswarm_orchestrator.recording.schemas import ARENA_FRAME, ROOT_FRAME, SCENE_TOPICS

LAYOUT = "layout.json"
"""The layout's file in the run's folder."""


def layout_json(width_m: float, height_m: float) -> bytes:
    """Return the content of the layout's file."""
    return orjson.dumps(layout(width_m, height_m), option=orjson.OPT_INDENT_2)


def layout(width_m: float, height_m: float) -> dict[str, Any]:
    """Make a viewer's layout for an arena: the scene from above, workload, trees, log.

    The background is white because events are black. The camera is far enough away to show the whole arena.
    """
    longest_m = max(width_m, height_m)
    distance_m = 1.4 * longest_m  # at 45 degrees of view this shows 1.16 times the longest side
    scene = {
        "cameraState": {
            "perspective": True,
            "distance": distance_m,
            "phi": 0,
            "thetaOffset": 0,
            "targetOffset": [0, 0, 0],
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.5,
            "far": max(5000, 4 * distance_m),
        },
        "followMode": "follow-pose",
        "followTf": ROOT_FRAME,
        "scene": {
            "backgroundColor": "#ffffff",
            "transforms": {"labelSize": longest_m / 80, "axisScale": longest_m / 100},
        },
        # viewers draw no line to a frame whose parent is hidden
        "transforms": {f"frame:{frame}": {"visible": False} for frame in (ROOT_FRAME, ARENA_FRAME)},
        "topics": {topic: {"visible": True} for topic in SCENE_TOPICS},
        "layers": {
            "grid": {
                "layerId": "foxglove.Grid",
                "instanceId": "grid",
                "visible": True,
                "frameLocked": True,
                "label": "Grid",
                "frameId": ROOT_FRAME,
                "size": longest_m,
                "divisions": 10,
                "lineWidth": 1,
                "color": "#e4e4e4ff",
                "position": [0, 0, 0],
                "rotation": [0, 0, 0],
            }
        },
    }
    rates = ("/operator/workload.rate_1s_hz", "/operator/workload.rate_60s_hz")
    counts = ("/swarm/state.agents_in_trees", "/swarm/state.trees", "/swarm/state.events_open")
    return {
        "configById": {
            "3D!arena": scene,
            "Plot!workload": _plot("Reports to the operator [1/s]", rates),
            "Plot!trees": _plot("Agents in trees, trees, open events", counts),
            "RosOut!log": {"topicToRender": "/log", "minLogLevel": 1, "searchTerms": []},
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": "3D!arena",
            "second": {
                "direction": "column",
                "first": "Plot!workload",
                "second": {"direction": "column", "first": "Plot!trees", "second": "RosOut!log"},
                "splitPercentage": 36,
            },
            "splitPercentage": 60,
        },
    }


def _plot(title: str, paths: Iterable[str]) -> dict[str, Any]:
    return {
        **dict.fromkeys(("foxglovePanelTitle", "lichtblickPanelTitle"), title),
        "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
    }
