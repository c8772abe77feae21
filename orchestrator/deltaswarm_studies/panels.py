"""Shared by figures of several kinds: selection of rows, panels, lines and legends.

A factor is shown by position (the axis), by colour (the hue) or by panel (the facet).
"""

import itertools
import math
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deltaswarm_studies import looks, style
from deltaswarm_studies.captions import heights
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.kinds import KINDS
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.stats import Floats
from deltaswarm_studies.study import Study
from deltaswarm_studies.style import Look

COLUMNS = 3
"""Most panels side by side."""

HEIGHT_IN = 1.6
"""Least height of a panel without what is around it [in]."""

TICKS_IN = 1.2
"""Height of labels below an axis for which a figure has room [in]; with taller ones it is taller itself."""

LETTERS_UP = 36
"""Most letters along the vertical axis; a longer label has two lines."""

OUTLINE: dict[str, Any] = {"markeredgecolor": style.BLACK, "markeredgewidth": 0.4}

MANY = 60
"""With more points of a kind than this they are small and without outlines, or they would hide boxes and ellipses."""

DASHES = ((0, (6, 3)), (0, (2, 2)), (0, (8, 2, 2, 2)), (0, (1, 2)))
"""Of the horizontal lines of a figure, in their order."""

Draw = Callable[[Axes, pd.DataFrame], None]


@dataclass(frozen=True)
class Frame:
    """What is around the panels."""

    x_label: str
    handles: Sequence[Line2D] = ()
    """Of the legend, besides the figure's lines."""
    legend_title: str = ""
    width_in: float = 1.3
    """Least width of a panel [in]; panels are side by side only as far as they have it."""
    starts_at_zero: bool = True
    """Whether the vertical axis starts at 0 if there are no negative values."""
    y_label: str = ""
    """Empty: the metric's."""


def panels(
    settings: FigureSettings, study: Study, evidence: Evidence, rows: pd.DataFrame, draw: Draw, frame: Frame
) -> Figure:
    """Draw a panel per level of the facet, with shared axes, and a legend below all panels."""
    facets = levels_in(settings, study, settings.facet) if settings.facet else [""]
    columns = max(1, min(len(facets), COLUMNS, int((style.TEXT_IN - 0.5) / frame.width_in)))
    lines = math.ceil(len(facets) / columns)
    handles = [*frame.handles]
    y_label = frame.y_label or study.metrics[settings.metric].label
    with style.drawing():
        figure = style.new_figure(style.TEXT_IN, 2.5 if lines == 1 else 2.1 * lines)
        grid = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
        for place, axes in enumerate(grid.flat):
            if place >= len(facets):
                axes.set_visible(False)
                continue
            own = rows[rows[settings.facet] == facets[place]] if settings.facet else rows
            draw(axes, own)
            if own[settings.metric].isna().all():
                axes.annotate("no values", (0.5, 0.5), xycoords="axes fraction", ha="center", va="center")
            if settings.facet:
                axes.set_title(style.shown(study.level_title(settings.facet, facets[place])))
            axes.grid(True, axis="y", color=style.PALE, linewidth=0.5)
            axes.set_axisbelow(True)
            if place + columns >= len(facets):  # nothing below it
                axes.set_xlabel(frame.x_label)
                axes.tick_params(labelbottom=True)
        for (words, value), dashes in zip(heights(settings, study, evidence, rows).items(), itertools.cycle(DASHES)):
            look: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.7, "linestyle": dashes}
            for axes in grid.flat:
                axes.axhline(value, zorder=1, **look)
            handles.append(Line2D([], [], label=style.shown(words), **look))
        if frame.starts_at_zero and rows[settings.metric].min() >= 0:
            grid[0, 0].set_ylim(bottom=0)
        for axes in grid[:, 0]:
            width = LETTERS_UP if len(y_label) <= LETTERS_UP else len(y_label) // 2 + 5
            axes.set_ylabel("\n".join(textwrap.wrap(style.shown(y_label), width)))
        if handles:
            style.add_legend(figure, handles, frame.legend_title)
    style.laid_out(figure, max(0.0, _tallest_in(figure) - TICKS_IN))
    short_in = HEIGHT_IN - grid[0, 0].bbox.height / figure.dpi
    return figure if short_in <= 0 else style.laid_out(figure, lines * short_in)


def _tallest_in(figure: Figure) -> float:
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    with style.drawing():
        ticks = [label for axes in figure.axes if axes.get_visible() for label in axes.get_xticklabels()]
        return max(label.get_window_extent(renderer).height for label in ticks) / figure.dpi


# Rows


def chosen(settings: FigureSettings, study: Study, rows: pd.DataFrame, variants: Sequence[str] = ()) -> pd.DataFrame:
    """Select the rows of the figure's variants, in their order."""
    order = {name: place for place, name in enumerate(variants or settings.variants or study.levels)}
    rows = rows[rows["variant"].isin(order)] if len(rows) else rows
    if rows.empty:
        raise ValueError("there are no runs for it")
    for name in KINDS[settings.kind].metrics:
        metric = getattr(settings, name)
        if metric not in rows or rows[metric].isna().all():
            raise ValueError(f"there are no values of {study.metrics[metric].title!r}")
    return rows.sort_values("variant", key=lambda names: names.map(order), kind="stable")


def per_replicate(settings: FigureSettings, study: Study, rows: pd.DataFrame) -> pd.DataFrame:
    """Average each replicate over the factors that a figure leaves out, if it has runs of all of their levels.

    The levels are no replicates, and a mean over some of them compares with no other.
    """
    kind = KINDS[settings.kind]
    shown = list(dict.fromkeys(filter(None, (getattr(settings, name) for name in kind.factors))))
    metrics = list(dict.fromkeys(getattr(settings, name) for name in kind.metrics))
    variants = settings.variants or study.levels
    of = Counter(tuple(study.levels[name][factor] for factor in shown) for name in variants)
    groups = rows.groupby([*shown, "replicate"], sort=False)
    means, sizes = groups[metrics].agg(_mean_of_all), groups.size()
    return means.where(sizes == [of[cell[:-1]] for cell in sizes.index]).reset_index()


def _mean_of_all(values: pd.Series) -> float:
    return float(values.mean(skipna=False))


def levels_in(settings: FigureSettings, study: Study, factor: str) -> list[str]:
    """Return the levels of a factor in the figure's variants, in their order, whether there are runs of them or not."""
    return list(dict.fromkeys(study.levels[name][factor] for name in settings.variants or study.levels))


def hues(settings: FigureSettings, study: Study, rows: pd.DataFrame) -> dict[str, Look]:
    """Return the look of each level of the hue that has values; without a hue, one look with an empty name."""
    if not settings.hue:
        return {"": next(style.others())}
    of = looks.of_levels(study, settings.hue)
    drawn = set(rows[rows[settings.metric].notna()][settings.hue])
    return {hue: of[hue] for hue in levels_in(settings, study, settings.hue) if hue in drawn}


def points(axes: Axes, x: Any, middle: Floats, low: Floats, high: Floats, look: Look) -> None:
    """Draw estimates with their intervals, joined by a line."""
    bars: dict[str, Any] = {"markersize": 4.5, "capsize": 2, "elinewidth": 0.8, **OUTLINE}
    bars |= {"color": look.colour, "linestyle": look.line, "marker": look.marker}
    axes.errorbar(x, middle, whiskers(middle, low, high), **bars)


def whiskers(middle: Floats, low: Floats, high: Floats) -> Floats:
    """Return the lengths (2, n) of intervals below and above the medians; NaN, which draws none, for none."""
    return np.stack([middle - low, high - middle])


# Legends


def handles(study: Study, factor: str, looks: Mapping[str, Look], **parts: bool) -> list[Line2D]:
    return [handle(look, study.level_name(factor, level), **parts) for level, look in looks.items() if factor]


def handle(look: Look, name: str, *, marker: bool = True, line: bool = True) -> Line2D:
    return Line2D(
        *([], []),
        color=look.colour,
        linestyle=look.line if line else "none",
        marker=look.marker if marker else "",
        markersize=4.5,
        label=style.shown(name),
        **OUTLINE,
    )
