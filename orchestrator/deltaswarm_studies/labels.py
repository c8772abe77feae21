"""Place the labels of points so that none overlaps another label or a point."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from deltaswarm_studies import style

HALO = withStroke(linewidth=2, foreground="white")

DIRECTIONS = 16
DISTANCES_PT = (5.0, 8.0, 12.0, 17.0, 23.0, 30.0)
"""Where a label may be: around its point, the nearest free place first [points]."""

LINE_FROM_PT = 10.0
"""From this distance a line leads from the label to its point."""

MARKER_PT = 3.0
"""Half the width of a marker [points]."""


LONGEST = 24
"""Letters of a label that is written beside its point."""


class Label(NamedTuple):
    axes: Axes
    text: str
    x: float
    y: float
    colour: str = style.BLACK


def place(figure: Figure, labels: Sequence[Label]) -> tuple[str, ...]:
    """Write each label beside its point; the figure must be laid out.

    If one is long, all points are numbered. Return what the caption must then say.
    """
    names = list(dict.fromkeys(label.text for label in labels))
    are_long = any(len(name) > LONGEST for name in names)
    with style.drawing():
        _place(
            figure, [label._replace(text=str(names.index(label.text) + 1)) for label in labels] if are_long else labels
        )
    return (f"Points: {'; '.join(f'{place}: {name}' for place, name in enumerate(names, 1))}.",) if are_long else ()


def _place(figure: Figure, labels: Sequence[Label]) -> None:
    pixels = figure.dpi / 72
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    points = [label.axes.transData.transform((label.x, label.y)) for label in labels]
    taken = [_box(x, y, MARKER_PT * pixels, MARKER_PT * pixels) for x, y in points]
    for label, (x, y) in zip(labels, points, strict=True):
        note = label.axes.annotate(
            style.shown(label.text),
            (label.x, label.y),
            (0, 0),
            textcoords="offset points",
            ha="center",
            va="center_baseline",
            zorder=5,
            color=label.colour,
            path_effects=[HALO],
        )
        size = note.get_window_extent(renderer)
        frame = label.axes.bbox
        best = (math.inf, 0.0, 0.0, size)
        for distance in DISTANCES_PT:
            for turn in range(DIRECTIONS):
                angle = math.pi / 4 + 2 * math.pi * turn / DIRECTIONS
                dx = math.cos(angle) * (distance * pixels + size.width / 2)
                dy = math.sin(angle) * (distance * pixels + size.height / 2)
                box = _box(x + dx, y + dy, size.width / 2, size.height / 2)
                outside = box.width * box.height - _shared(box, frame)
                cost = sum(_shared(box, other) for other in taken) + outside
                if cost < best[0] - 1e-9:
                    best = (cost, dx, dy, box)
            if best[0] < 1e-9:
                break
        _, dx, dy, box = best
        note.set_position((dx / pixels, dy / pixels))
        taken.append(box)
        if math.hypot(max(abs(dx) - size.width / 2, 0), max(abs(dy) - size.height / 2, 0)) > LINE_FROM_PT * pixels:
            label.axes.annotate(
                "",
                (label.x, label.y),
                (dx / pixels, dy / pixels),
                textcoords="offset points",
                zorder=4.5,
                arrowprops={"arrowstyle": "-", "linewidth": 0.4, "color": style.GREY, "shrinkA": 3, "shrinkB": 2},
            )


def _box(x: float, y: float, half_width: float, half_height: float) -> Bbox:
    return Bbox.from_extents(x - half_width, y - half_height, x + half_width, y + half_height)


def _shared(one: Bbox, other: Bbox) -> float:
    width = min(one.x1, other.x1) - max(one.x0, other.x0)
    height = min(one.y1, other.y1) - max(one.y0, other.y0)
    return float(max(width, 0.0) * max(height, 0.0))
