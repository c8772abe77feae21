"""The figures of a study along a factor or over time: boxes, levels, courses.

A factor is shown by position (the axis), by colour (the hue) or by panel (the facet). A level looks the same in every
figure of a study, whichever levels the figure shows.
"""

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from deltaswarm_orchestrator.report.plots import style
from deltaswarm_orchestrator.report.plots.style import Look
from deltaswarm_orchestrator.stats import describe
from deltaswarm_orchestrator.studies.panels import chosen, handle, handles, hues, looks, or_nan, panels, there
from deltaswarm_orchestrator.studies.settings import FigureSettings
from deltaswarm_orchestrator.studies.study import Study

Floats = npt.NDArray[np.float64]

BOX_FROM = 5
"""Fewest values for a box; with fewer, only points are drawn, since the quartiles would be the points themselves."""
UPRIGHT = 7
"""With more categories than this, the names under the axis are rotated."""


def boxes(settings: FigureSettings, study: Study, runs: pd.DataFrame) -> Figure:
    """Draw one box per level of the factor `x` (and of the hue), with a point per replicate."""
    shown = chosen(settings, runs, settings.variants)
    levels = there(shown, settings.x, study)
    told_apart = there(shown, settings.hue, study) if settings.hue else levels
    look_of = looks(study, settings.hue or settings.x)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for place, level in enumerate(levels):
            for name, offset, width in _side_by_side(told_apart if settings.hue else [level]):
                own = rows[(rows[settings.x] == level) & (rows[settings.hue or settings.x] == name)]
                values = own[settings.metric].dropna().to_numpy(dtype=np.float64)
                _box(axes, values, place + offset, width, look_of[name])
                if published := settings.published.get(level if not settings.hue else f"{level}, {name}"):
                    _published(axes, place + offset + 0.55 * width, *published)
        _categories(axes, levels)

    named = [handle(look_of[name], name, line=False) for name in told_apart] if settings.hue else []
    named += [_PUBLISHED] if settings.published else []
    return panels(settings, study, shown, draw, named, study.factor_title(settings.x))


def levels(settings: FigureSettings, study: Study, runs: pd.DataFrame) -> Figure:
    """Draw medians with exact 95 % intervals along a factor: at its levels' numbers if they have any, else evenly."""
    shown = chosen(settings, runs, settings.variants)
    names = there(shown, settings.x, study)
    places = study.numbers(settings.x)
    at = {name: places[name] if places else float(index) for index, name in enumerate(names)}
    ordered = sorted(names, key=at.__getitem__)
    look_of = hues(settings, study, shown)
    apart = 0.012 * (max(at.values()) - min(at.values()) or 1.0)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for index, (hue, look) in enumerate(look_of.items()):
            own = rows[rows[settings.hue] == hue] if hue else rows
            found = [describe(own[own[settings.x] == name][settings.metric]) for name in ordered]
            middle = np.array([or_nan(one.median) for one in found])
            low = np.array([or_nan(one.low) for one in found])
            high = np.array([or_nan(one.high) for one in found])
            x = np.array([at[name] for name in ordered]) + apart * (index - (len(look_of) - 1) / 2)
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

    return panels(settings, study, shown, draw, handles(look_of), study.factor_title(settings.x))


def time(settings: FigureSettings, study: Study, courses: pd.DataFrame) -> Figure:
    """Draw means over the replicates with 95 % intervals, each over its window of time."""
    courses = courses[courses["metric"] == settings.metric].rename(columns={"mean": settings.metric})
    shown = chosen(settings, courses, settings.variants)
    look_of = hues(settings, study, shown)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for hue, look in look_of.items():
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

    return panels(settings, study, shown, draw, handles(look_of, marker=False), "time [s]")


_PUBLISHED = Line2D([], [], linestyle="none", marker="D", color=style.BLACK, markersize=3.2, label="published")


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
