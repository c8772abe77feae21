"""Wrap titles and axis labels so that none is cut off or overlaps another."""

import textwrap
from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox, BboxBase

LEAST_LETTERS = 6
"""A line is not made shorter."""

FRAME_IN = 0.5
"""Width of what is beside all columns [in]."""

COLUMN = 0.9
"""The share of a column that a line may fill."""

MARGIN_PX = 1.0
"""What a box may be over an edge by rounding [pixels]."""


class Place(NamedTuple):
    """A title or label, and the room that it has beside its axes."""

    axes: Axes
    text: Text
    box: Bbox
    is_upright: bool = False

    @property
    def share(self) -> float:
        """The share of its length for which there is room: beside its axes, or in its column if that is wider."""
        if self.is_upright:
            return self.axes.bbox.height / self.box.height
        figure, subplot = self.axes.figure, self.axes.get_subplotspec()
        column = (figure.bbox.width - FRAME_IN * figure.dpi) / (subplot.get_gridspec().ncols if subplot else 1)
        before = (self.box.x0 - self.axes.bbox.x0) / self.axes.bbox.width if self.text in self.axes.texts else 0.0
        return (1 - before) * max(self.axes.bbox.width, COLUMN * column) / self.box.width


def wrapped(figure: Figure) -> int:
    """Wrap each text that is cut off or lies on another one; return how many lines this adds to the figure's rows."""
    places = list(_places(figure))
    added: dict[int, int] = defaultdict(int)
    for place in places:
        others = [other.box for other in places if other is not place and other.is_upright == place.is_upright]
        is_too_wide = place.text in place.axes.texts
        if not (is_too_wide or _is_cut(place.box, figure.bbox) or any(_overlap(place.box, other) for other in others)):
            continue
        before = place.text.get_text()
        longest = max(map(len, before.split("\n")))
        letters = max(LEAST_LETTERS, int(min(longest - 1, longest * place.share)))
        after = "\n".join(textwrap.wrap(before, letters))
        if after != before and max(map(len, after.split("\n"))) < longest:
            place.text.set_text(after)
            row = 0 if place.is_upright else round(place.axes.bbox.y0)
            lines = 0 if place.is_upright else after.count("\n") - before.count("\n")
            added[row] = max(added[row], lines, 0)
    return sum(added.values()) or int(bool(added))


def _places(figure: Figure) -> Iterator[Place]:
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    for axes in figure.axes:
        if not axes.get_visible():
            continue
        for text in axes.texts:
            box = text.get_window_extent(renderer)
            if text.get_text() and box.width > axes.bbox.width and box.x0 < axes.bbox.x1:
                yield Place(axes, text, box)
        for text, is_upright in ((axes.title, False), (axes.xaxis.label, False), (axes.yaxis.label, True)):
            if text.get_text() and text.get_visible():
                yield Place(axes, text, text.get_window_extent(renderer), is_upright)


def _is_cut(box: Bbox, page: BboxBase) -> bool:
    return bool(
        box.x0 < page.x0 - MARGIN_PX
        or box.y0 < page.y0 - MARGIN_PX
        or box.x1 > page.x1 + MARGIN_PX
        or box.y1 > page.y1 + MARGIN_PX
    )


def _overlap(one: Bbox, other: Bbox) -> bool:
    return bool(min(one.x1, other.x1) - max(one.x0, other.x0) > 0 and min(one.y1, other.y1) - max(one.y0, other.y0) > 0)
