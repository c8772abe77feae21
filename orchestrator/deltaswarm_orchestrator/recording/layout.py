"""The layout for Foxglove and Lichtblick: the scene from above, workload, trees, log."""

from pathlib import Path
from typing import Any

import orjson

LAYOUT = "layout.json"
"""The layout's file in the run's folder."""

TEMPLATE = Path(__file__).with_name("layout_template.json")
"""A layout as viewers export it, without what depends on the arena's size.

Its background is white because events are black. Frames are hidden only one by one, since viewers draw no line to a
frame whose parent is hidden.
"""


def layout_json(width_m: float, height_m: float) -> bytes:
    """Return the content of the layout's file."""
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
