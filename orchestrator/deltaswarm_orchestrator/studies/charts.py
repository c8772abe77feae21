"""The figures of a study: boxes, levels, courses over time, and one metric against another.

A factor is shown by position (the axis), by colour (the hue) or by panel (the facet). A level looks the same in every
figure of a study, whichever levels the figure shows.
"""

import math
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.patheffects import withStroke

from deltaswarm_orchestrator.report.plots import style
from deltaswarm_orchestrator.report.plots.style import Look
from deltaswarm_orchestrator.stats import describe
from deltaswarm_orchestrator.studies.study import FigureSettings, Study

Floats = npt.NDArray[np.float64]

BOX_FROM = 5
"""Fewest values for a box; with fewer, only points are drawn, since the quartiles would be the points themselves."""
COLUMNS = 3
"""Most panels side by side."""
UPRIGHT = 7
"""With more categories than this, the names under the axis are rotated."""


def boxes(settings: FigureSettings, study: Study, runs: pd.DataFrame) -> Figure:
    """Draw one box per level of the factor `x` (and of the hue), with a point per replicate."""
    shown = _chosen(settings, runs)
    levels = _there(shown, settings.x, study)
    hues = _there(shown, settings.hue, study) if settings.hue else levels
    looks = _looks(study, settings.hue or settings.x)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for place, level in enumerate(levels):
            for name, offset, width in _side_by_side(hues if settings.hue else [level]):
                own = rows[(rows[settings.x] == level) & (rows[settings.hue or settings.x] == name)]
                values = own[settings.metric].dropna().to_numpy(dtype=np.float64)
                _box(axes, values, place + offset, width, looks[name])
                if published := settings.published.get(level if not settings.hue else f"{level}, {name}"):
                    _published(axes, place + offset + 0.55 * width, *published)
        _categories(axes, levels)

    named = [_handle(looks[name], name, line=False) for name in hues] if settings.hue else []
    named += [_PUBLISHED] if settings.published else []
    return _panels(settings, study, shown, draw, named, study.factor_title(settings.x))


def levels(settings: FigureSettings, study: Study, runs: pd.DataFrame) -> Figure:
    """Draw medians with exact 95 % intervals along a factor: at its levels' numbers if they have any, else evenly."""
    shown = _chosen(settings, runs)
    names = _there(shown, settings.x, study)
    places = study.numbers(settings.x)
    at = {name: places[name] if places else float(index) for index, name in enumerate(names)}
    ordered = sorted(names, key=at.__getitem__)
    hues = _hues(settings, study, shown)
    apart = 0.012 * (max(at.values()) - min(at.values()) or 1.0)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for index, (hue, look) in enumerate(hues.items()):
            own = rows[rows[settings.hue] == hue] if hue else rows
            found = [describe(own[own[settings.x] == name][settings.metric]) for name in ordered]
            middle = np.array([_or_nan(one.median) for one in found])
            low = np.array([_or_nan(one.low) for one in found])
            high = np.array([_or_nan(one.high) for one in found])
            x = np.array([at[name] for name in ordered]) + apart * (index - (len(hues) - 1) / 2)
            whiskers = np.nan_to_num(np.stack([middle - low, high - middle]))
            axes.errorbar(
                *(x, middle, whiskers),
                color=look.colour,
                linestyle=look.line,
                marker=look.marker,
                markersize=4.5,
                markeredgecolor=style.BLACK,
                markeredgewidth=0.4,
                capsize=2,
                elinewidth=0.8,
            )
        if not places:
            _categories(axes, names)

    return _panels(settings, study, shown, draw, _handles(hues), study.factor_title(settings.x))


def time(settings: FigureSettings, study: Study, courses: pd.DataFrame) -> Figure:
    """Draw means over the replicates with 95 % intervals, each over its window of time."""
    courses = courses[courses["metric"] == settings.metric].rename(columns={"mean": settings.metric})
    shown = _chosen(settings, courses)
    hues = _hues(settings, study, shown)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for hue, look in hues.items():
            own = (rows[rows[settings.hue] == hue] if hue else rows).sort_values("time_s")
            if own.empty:
                continue
            edges = np.array([*own["time_s"], own["time_s"].iloc[-1] + study.file.study.window_s])
            line: dict[str, Any] = {"color": look.colour, "linestyle": look.line, "linewidth": 1.2}
            axes.stairs(own[settings.metric], edges, baseline=None, **line)
            low, high = ([*own[name], own[name].iloc[-1]] for name in ("low", "high"))
            axes.fill_between(edges, low, high, step="post", color=look.colour, alpha=0.2, linewidth=0)
        for span in settings.spans:
            until_s = span.from_s if span.until_s is None else span.until_s
            axes.axvspan(span.from_s, until_s, color=style.GREY, alpha=0.15, linewidth=0.9, zorder=0)
            place: dict[str, Any] = {"xycoords": axes.get_xaxis_transform(), "textcoords": "offset points"}
            axes.annotate(span.text, (span.from_s, 1.0), (3, -3), va="top", **place)
        axes.margins(x=0)

    return _panels(settings, study, shown, draw, _handles(hues, marker=False), "time [s]")


def plane(settings: FigureSettings, study: Study, runs: pd.DataFrame) -> Figure:
    """Draw a point per replicate, and an ellipse of one standard deviation around the mean of each level of the hue."""
    shown = _chosen(settings, runs)
    hues = _hues(settings, study, shown)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for hue, look in hues.items():
            points = rows[rows[settings.hue] == hue][[settings.x, settings.metric]].dropna().to_numpy(np.float64)
            _cloud(axes, points, look)
        medians = rows.groupby("variant")[[settings.x, settings.metric]].median()
        path = [name for name in settings.path if name in medians.index]
        joined = medians.loc[path].to_numpy(np.float64)
        axes.plot(*joined.T, color=style.BLACK, linewidth=0.8, zorder=4)
        for name, (x_at, y_at) in zip(path, joined, strict=True):
            number = style.delta_of(name)
            words = name if number is None else str(number)
            axes.annotate(words, (x_at, y_at), (4, 3), textcoords="offset points", zorder=5, path_effects=[_HALO])

    return _panels(settings, study, shown, draw, _handles(hues), study.metrics[settings.x].label)


def ellipse(points: Floats) -> tuple[float, float, float]:
    """Return full width, full height and angle [deg] of the ellipse of one standard deviation of points (n, 2)."""
    variances, directions = np.linalg.eigh(np.cov(points, rowvar=False))
    width, height = 2 * np.sqrt(np.maximum(variances[::-1], 0.0))
    longest = directions[:, 1]
    return float(width), float(height), float(np.degrees(np.arctan2(longest[1], longest[0])))


_HALO = withStroke(linewidth=2, foreground="white")
_PUBLISHED = Line2D([], [], linestyle="none", marker="D", color=style.BLACK, markersize=3.2, label="published")


def _panels(
    settings: FigureSettings,
    study: Study,
    rows: pd.DataFrame,
    draw: Callable[[Axes, pd.DataFrame], None],
    handles: Sequence[Line2D],
    x_label: str,
) -> Figure:
    """Draw a panel per level of the facet, with shared axes, and a legend below all panels."""
    facets = _there(rows, settings.facet, study) if settings.facet else [""]
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
        if (rows[settings.metric].min() >= 0) and settings.kind != "plane":
            grid[0, 0].set_ylim(bottom=0)
        for axes in grid[-1]:
            axes.set_xlabel(x_label)
        for axes in grid[:, 0]:
            axes.set_ylabel(study.metrics[settings.metric].label)
        if handles:
            figure.legend(handles=list(handles), loc="outside lower center", ncols=3, columnspacing=1.2)
    return figure


def _chosen(settings: FigureSettings, rows: pd.DataFrame) -> pd.DataFrame:
    """Select the rows of the figure's variants, in the figure's order.

    Raises:
        ValueError: If there are no rows, or the metric has no values.
    """
    if settings.variants:
        rows = rows[rows["variant"].isin(settings.variants)]
        order = {name: place for place, name in enumerate(settings.variants)}
        rows = rows.sort_values("variant", key=lambda names: names.map(order), kind="stable")
    if rows.empty or rows[settings.metric].isna().all():
        raise ValueError(f"there are no values of {settings.metric!r} to draw")
    return rows


def _there(rows: pd.DataFrame, factor: str, study: Study) -> list[str]:
    """Return the levels of a factor that have rows, in the rows' order; all levels if the rows lack the factor."""
    return [str(level) for level in rows[factor].unique()] if factor in rows else list(study.factors[factor])


def _looks(study: Study, factor: str) -> dict[str, Look]:
    return style.looks(study.factors[factor], repeat=True)


def _hues(settings: FigureSettings, study: Study, shown: pd.DataFrame) -> dict[str, Look]:
    """Return the look of each level of the hue that has rows; without a hue, one look with an empty name."""
    if not settings.hue:
        return {"": style.OTHERS[0]}
    looks = _looks(study, settings.hue)
    return {hue: looks[hue] for hue in _there(shown, settings.hue, study)}


def _handles(hues: Mapping[str, Look], *, marker: bool = True) -> list[Line2D]:
    """Make the legend's handles for the hues that have a name."""
    return [_handle(look, hue, marker=marker) for hue, look in hues.items() if hue]


def _side_by_side(names: Sequence[str]) -> Iterator[tuple[str, float, float]]:
    """Yield each name with its offset from the middle of a category, and its width."""
    width = 0.8 / len(names)
    return ((name, (index - (len(names) - 1) / 2) * width, min(width, 0.5)) for index, name in enumerate(names))


def _box(axes: Axes, values: Floats, place: float, width: float, look: Look) -> None:
    """Draw quartiles, median, whiskers to the farthest value within 1.5 interquartile ranges, and the values."""
    if len(values) >= BOX_FROM:
        found, half = boxplot_stats(values)[0], width * 0.42
        corner, height = (place - half, found["q1"]), found["q3"] - found["q1"]
        face: dict[str, Any] = {"facecolor": look.tint, "edgecolor": look.colour, "hatch": look.hatch}
        axes.add_patch(Rectangle(corner, 2 * half, height, zorder=2, **face))
        for near, far in ((found["q1"], found["whislo"]), (found["q3"], found["whishi"])):
            axes.plot([place, place], [near, far], color=style.GREY, linewidth=0.8)
        axes.plot([place - half, place + half], [found["med"]] * 2, color=style.BLACK, linewidth=1.6, zorder=2.5)
    spread = (np.arange(1, len(values) + 1) * (5**0.5 - 1) / 2) % 1.0 - 0.5  # golden ratio: even and repeatable
    points: dict[str, Any] = {
        "s": 9,
        "marker": look.marker,
        "facecolors": "white" if len(values) >= BOX_FROM else look.colour,  # else nothing has the level's colour
        "edgecolors": style.BLACK,
        "linewidths": 0.5,
    }
    axes.scatter(place + spread * width * 0.6, values, zorder=3, **points)


def _published(axes: Axes, place: float, median: float, iqr: float) -> None:
    bars: dict[str, Any] = {"color": style.BLACK, "markersize": 3.2, "capsize": 2, "elinewidth": 0.8}
    axes.errorbar([place], [median], [[iqr / 2], [iqr / 2]], fmt="D", **bars)


def _categories(axes: Axes, names: Sequence[str]) -> None:
    turned = len(names) > UPRIGHT
    room = max(8, round(66 / len(names)))
    words = [style.shown(name) for name in names]
    words = words if turned else ["\n".join(textwrap.wrap(text, room)) if "$" not in text else text for text in words]
    axes.set_xticks(range(len(names)), words, rotation=40 if turned else 0, ha="right" if turned else "center")
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.tick_params(axis="x", length=0)


def _cloud(axes: Axes, points: Floats, look: Look) -> None:
    if len(points) > 1:
        width, height, angle = ellipse(points)
        edge = style.mix(look.colour, style.BLACK, 0.35)
        centre = (float(points[:, 0].mean()), float(points[:, 1].mean()))
        colours: dict[str, Any] = {
            "facecolor": (look.colour, 0.3),
            "edgecolor": edge,
            "linestyle": look.line,
            "linewidth": 0.9,
        }
        axes.add_patch(Ellipse(centre, width, height, angle=angle, **colours))
    edge_of: dict[str, Any] = {"edgecolors": style.BLACK, "linewidths": 0.35}
    axes.scatter(points[:, 0], points[:, 1], s=14, marker=look.marker, color=look.colour, zorder=3, **edge_of)


def _handle(look: Look, name: str, *, marker: bool = True, line: bool = True) -> Line2D:
    return Line2D(
        [],
        [],
        color=look.colour,
        linestyle=look.line if line else "none",
        marker=look.marker if marker else "",
        markersize=4.5,
        markeredgecolor=style.BLACK,
        markeredgewidth=0.35,
        label=style.shown(name),
    )


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


CHARTS: Mapping[str, Callable[[FigureSettings, Study, pd.DataFrame], Figure]] = {
    "boxes": boxes,
    "levels": levels,
    "time": time,
    "plane": plane,
}
"""The drawing function of each kind of figure in a study file; `time` takes courses, the others take runs."""
