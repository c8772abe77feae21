"""What the figures of a study share: panels by facet, the rows that a figure shows, looks and legends."""

import math
from collections.abc import Callable, Mapping, Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from deltaswarm_studies.plots import style
from deltaswarm_studies.plots.style import Look
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.study import Study

COLUMNS = 3
"""Most panels side by side."""

PLANES = ("plane", "frontier")
"""Kinds of figures with a metric along each axis."""


def panels(
    settings: FigureSettings,
    study: Study,
    rows: pd.DataFrame,
    draw: Callable[[Axes, pd.DataFrame], None],
    handles: Sequence[Line2D],
    x_label: str,
) -> Figure:
    """Draw a panel per level of the facet, with shared axes, and a legend below all panels."""
    facets = levels_in(rows, settings.facet, study) if settings.facet else [""]
    columns = min(len(facets), COLUMNS)
    lines = math.ceil(len(facets) / columns)
    legend_rows = math.ceil(len(handles) / 3)
    with style.drawing():
        figure = style.new_figure(style.TEXT_IN, 2.5 * lines + 0.18 * legend_rows)
        grid = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
        for index, axes in enumerate(grid.flat):
            if index >= len(facets):
                axes.set_visible(False)
                continue
            draw(axes, rows[rows[settings.facet] == facets[index]] if settings.facet else rows)
            axes.set_title(style.shown(facets[index]))
            axes.grid(True, axis="y", color=style.PALE, linewidth=0.5)
            axes.set_axisbelow(True)
            for words, value in settings.lines.items():
                axes.axhline(value, color=style.BLACK, linewidth=0.7, linestyle=(0, (6, 3)), zorder=1)
                axes.annotate(words, (0.995, value), (0, 2), xycoords=axes.get_yaxis_transform(),
                              textcoords="offset points", ha="right", va="bottom")  # fmt: skip
        if (rows[settings.metric].min() >= 0) and settings.kind not in PLANES:
            grid[0, 0].set_ylim(bottom=0)
        for axes in grid[-1]:
            axes.set_xlabel(x_label)
        for axes in grid[:, 0]:
            axes.set_ylabel(study.metrics[settings.metric].label)
        if handles:
            figure.legend(handles=list(handles), loc="outside lower center", ncols=3, columnspacing=1.2)
    return figure


def chosen(settings: FigureSettings, rows: pd.DataFrame, variants: Sequence[str]) -> pd.DataFrame:
    """Select the rows of these variants, in this order; of all, if there are none.

    Raises:
        ValueError: If there are no rows, or a metric has no values.
    """
    if variants:
        rows = rows[rows["variant"].isin(variants)]
        order = {name: place for place, name in enumerate(variants)}
        rows = rows.sort_values("variant", key=lambda names: names.map(order), kind="stable")
    for metric in (settings.metric, *([settings.x] if settings.kind in PLANES else [])):
        if metric not in rows or rows[metric].isna().all():
            raise ValueError(f"there are no values of {metric!r} to draw")
    return rows


def levels_in(rows: pd.DataFrame, factor: str, study: Study) -> list[str]:
    """Return the levels of a factor that have rows, in the rows' order; all levels if the rows lack the factor."""
    return [str(level) for level in rows[factor].unique()] if factor in rows else list(study.factors[factor])


def looks(study: Study, factor: str) -> dict[str, Look]:
    """Return the look of each level of a factor."""
    return style.looks(study.factors[factor], repeat=True)


def hues(settings: FigureSettings, study: Study, shown: pd.DataFrame) -> dict[str, Look]:
    """Return the look of each level of the hue that has rows; without a hue, one look with an empty name."""
    if not settings.hue:
        return {"": style.OTHERS[0]}
    of = looks(study, settings.hue)
    return {hue: of[hue] for hue in levels_in(shown, settings.hue, study)}


def handles(hues: Mapping[str, Look], *, marker: bool = True, line: bool = True) -> list[Line2D]:
    """Make the legend's handles for the hues that have a name."""
    return [_handle(look, hue, marker, line) for hue, look in hues.items() if hue]


def _handle(look: Look, name: str, marker: bool, line: bool) -> Line2D:
    return Line2D(
        *([], []),
        color=look.colour,
        linestyle=look.line if line else "none",
        marker=look.marker if marker else "",
        markersize=4.5,
        markeredgecolor=style.BLACK,
        markeredgewidth=0.35,
        label=style.shown(name),
    )
