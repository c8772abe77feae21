"""The figures of a study: along a factor (boxes, levels), over time, and of two metrics (planes, frontiers).

A factor is shown by position (the axis), by colour (the hue) or by panel (the facet). A level looks the same in every
figure of a study, whichever levels the figure shows.
"""

import itertools
import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.patheffects import withStroke

from deltaswarm_studies import style
from deltaswarm_studies.drawing import Drawing
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.kinds import KINDS
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.stats import Floats, describe
from deltaswarm_studies.study import Study
from deltaswarm_studies.style import Look
from deltaswarm_studies.swarm import snapshot, swarm

COLUMNS = 3
"""Most panels side by side."""

OUTLINE: dict[str, Any] = {"markeredgecolor": style.BLACK, "markeredgewidth": 0.4}

HALO = withStroke(linewidth=2, foreground="white")

BOX_FROM = 5
"""Fewest values for a box; with fewer, only points are drawn, since the quartiles would be the points themselves."""
UPRIGHT = 7
"""With more categories than this, the names under the axis are rotated."""


def boxes(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw one box per level of the factor `x` (and of the hue), with a point per replicate."""
    shown = chosen(settings, evidence.runs, settings.variants)
    levels = levels_in(shown, settings.x, study)
    colours = levels_in(shown, settings.hue, study) if settings.hue else levels
    look_of = looks(study, settings.hue or settings.x)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        rows = per_replicate(rows, [settings.x, settings.hue], [settings.metric])
        for place, level in enumerate(levels):
            for name, offset, width in _side_by_side(colours if settings.hue else [level]):
                cell = rows[(rows[settings.x] == level) & (rows[settings.hue or settings.x] == name)]
                values = cell[settings.metric].dropna().to_numpy(dtype=np.float64)
                _box(axes, values, place + offset, width, look_of[name])
                if published := settings.published.get(level if not settings.hue else f"{level}, {name}"):
                    median, iqr = published
                    bars: dict[str, Any] = {"color": style.BLACK, "markersize": 3.2, "capsize": 2, "elinewidth": 0.8}
                    at = place + offset + 0.55 * width
                    axes.errorbar([at], [median], [[iqr / 2], [iqr / 2]], fmt="D", **bars)
        _categories(axes, levels)

    legend = handles({name: look_of[name] for name in colours}, line=False) if settings.hue else []
    legend += [_PUBLISHED] if settings.published else []
    return panels(settings, study, evidence, shown, draw, legend, study.factor_title(settings.x))


def levels(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw medians with exact 95 % intervals along a factor: at its levels' numbers if they have any, else evenly."""
    shown = chosen(settings, evidence.runs, settings.variants)
    names = levels_in(shown, settings.x, study)
    places = study.numbers(settings.x)
    at = {name: places[name] if places else float(index) for index, name in enumerate(names)}
    ordered = sorted(names, key=at.__getitem__)
    look_of = hues(settings, study, shown)
    apart = 0.012 * (max(at.values()) - min(at.values()) or 1.0)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        rows = per_replicate(rows, [settings.x, settings.hue], [settings.metric])
        for index, (hue, look) in enumerate(look_of.items()):
            group = rows[rows[settings.hue] == hue] if hue else rows
            middle, low, high = _medians(group[group[settings.x] == name][settings.metric] for name in ordered)
            x = np.array([at[name] for name in ordered]) + apart * (index - (len(look_of) - 1) / 2)
            axes.errorbar(
                *(x, middle, _whiskers(middle, low, high)),
                color=look.colour,
                linestyle=look.line,
                marker=look.marker,
                markersize=4.5,
                capsize=2,
                elinewidth=0.8,
                **OUTLINE,
            )
        if not places:
            _categories(axes, names)

    return panels(settings, study, evidence, shown, draw, handles(look_of), study.factor_title(settings.x))


def time(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw means over the replicates with 95 % intervals, each over its window of time."""
    courses = evidence.courses
    if len(courses):
        courses = courses[courses["metric"] == settings.metric].rename(columns={"mean": settings.metric})
    shown = chosen(settings, courses, settings.variants)
    look_of = hues(settings, study, shown)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for hue, look in look_of.items():
            group = (rows[rows[settings.hue] == hue] if hue else rows).sort_values("time_s")
            if group.empty:
                continue
            last = group.iloc[-1]
            edges = np.array([*group["time_s"], last["time_s"] + study.file.study.window_s])
            line: dict[str, Any] = {"color": look.colour, "linestyle": look.line, "linewidth": 1.2}
            axes.stairs(group[settings.metric], edges, baseline=None, **line)
            low, high = ([*group[name], last[name]] for name in ("low", "high"))
            axes.fill_between(edges, low, high, step="post", color=look.colour, alpha=0.2, linewidth=0)
        for span in settings.spans:
            until_s = span.from_s if span.until_s is None else span.until_s
            axes.axvspan(span.from_s, until_s, color=style.GREY, alpha=0.15, linewidth=0.9, zorder=0)
            place: dict[str, Any] = {"xycoords": axes.get_xaxis_transform(), "textcoords": "offset points"}
            axes.annotate(span.text, (span.from_s, 1.0), (3, -3), va="top", **place)
        axes.margins(x=0)

    return panels(settings, study, evidence, shown, draw, handles(look_of, marker=False), "time [s]")


def plane(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw a point per replicate, and an ellipse of one standard deviation around the mean of each level of the hue."""
    shown = chosen(settings, evidence.runs, settings.variants)
    look_of = hues(settings, study, shown)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        replicates = per_replicate(rows, [settings.hue], [settings.x, settings.metric])
        for hue, look in look_of.items():
            points = replicates[replicates[settings.hue] == hue][[settings.x, settings.metric]].dropna()
            _cloud(axes, points.to_numpy(np.float64), look)
        medians = rows.groupby("variant")[[settings.x, settings.metric]].median()
        path = [name for name in settings.path if name in medians.index]
        joined = medians.loc[path].to_numpy(np.float64)
        axes.plot(*joined.T, color=style.BLACK, linewidth=0.8, zorder=4)
        for name, (x_at, y_at) in zip(path, joined, strict=True):
            number = style.delta_of(name)
            _annotate(axes, name if number is None else str(number), (x_at, y_at))

    return panels(settings, study, evidence, shown, draw, handles(look_of), study.metrics[settings.x].label)


def frontier(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw the median of each variant with its 95 % intervals, and join those of each path; lower left is better."""
    shown = chosen(settings, evidence.runs, [*settings.variants, *itertools.chain(*settings.paths.values())])
    named = style.looks([*settings.paths, *settings.variants], repeat=True)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for name in (*settings.paths, *settings.variants):
            look, at = named[name], []
            for variant in settings.paths.get(name, [name]):
                replicates = rows[rows["variant"] == variant]
                (x, y), low, high = _medians((replicates[settings.x], replicates[settings.metric]))
                if np.isnan((x, y)).any():
                    continue
                at.append((x, y))
                x_bars, y_bars = _whiskers(np.array([x, y]), low, high).T.reshape(2, 2, 1)
                axes.errorbar(
                    *(x, y, y_bars, x_bars),
                    color=look.colour,
                    fmt=look.marker,
                    markersize=4.5,
                    elinewidth=0.6,
                    **OUTLINE,
                )
                if name in settings.paths:
                    _annotate(axes, variant.rpartition(" ")[2], (x, y))
            axes.plot(*np.array(at).reshape(-1, 2).T, color=look.colour, linestyle=look.line, linewidth=1.0, zorder=1)

    return panels(settings, study, evidence, shown, draw, handles(named), study.metrics[settings.x].label)


_PUBLISHED = Line2D([], [], linestyle="none", marker="D", color=style.BLACK, markersize=3.2, label="published")


def _medians(samples: Iterable[pd.Series]) -> Floats:
    """Return the median, and the lower and upper end of its interval, of each sample (3, n); NaN where undefined."""
    described = [(sample.median, sample.low, sample.high) for sample in map(describe, samples)]
    return np.array(described, dtype=np.float64).T


def _whiskers(middle: Floats, low: Floats, high: Floats) -> Floats:
    """Return the lengths (2, n) of intervals below and above the medians; 0 where there is no interval."""
    return np.nan_to_num(np.stack([middle - low, high - middle]))


def _annotate(axes: Axes, words: str, at: tuple[float, float]) -> None:
    axes.annotate(words, at, (4, 3), textcoords="offset points", zorder=5, path_effects=[HALO])


def _side_by_side(names: Sequence[str]) -> Iterator[tuple[str, float, float]]:
    """Yield each name with its offset from the middle of a category, and its width."""
    width = 0.8 / len(names)
    return ((name, (index - (len(names) - 1) / 2) * width, min(width, 0.5)) for index, name in enumerate(names))


def _box(axes: Axes, values: Floats, place: float, width: float, look: Look) -> None:
    """Draw quartiles, median, whiskers to the farthest value within 1.5 interquartile ranges, and the values."""
    if len(values) >= BOX_FROM:
        box, half = boxplot_stats(values)[0], width * 0.42
        corner, height = (place - half, box["q1"]), box["q3"] - box["q1"]
        face: dict[str, Any] = {"facecolor": look.tint, "edgecolor": look.colour, "hatch": look.hatch}
        axes.add_patch(Rectangle(corner, 2 * half, height, zorder=2, **face))
        for near, far in ((box["q1"], box["whislo"]), (box["q3"], box["whishi"])):
            axes.plot([place, place], [near, far], color=style.GREY, linewidth=0.8)
        axes.plot([place - half, place + half], [box["med"]] * 2, color=style.BLACK, linewidth=1.6, zorder=2.5)
    spread = (np.arange(1, len(values) + 1) * (5**0.5 - 1) / 2) % 1.0 - 0.5  # golden ratio: even and repeatable
    points: dict[str, Any] = {
        "s": 9,
        "marker": look.marker,
        "facecolors": "white" if len(values) >= BOX_FROM else look.colour,  # else nothing has the level's colour
        "edgecolors": style.BLACK,
        "linewidths": 0.5,
    }
    axes.scatter(place + spread * width * 0.6, values, zorder=3, **points)


def _categories(axes: Axes, names: Sequence[str]) -> None:
    turned = len(names) > UPRIGHT
    room = max(8, round(66 / len(names)))
    words = [style.shown(name) for name in names]
    words = words if turned else ["\n".join(textwrap.wrap(text, room)) if "$" not in text else text for text in words]
    axes.set_xticks(range(len(names)), words, rotation=40 if turned else 0, ha="right" if turned else "center")
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.tick_params(axis="x", length=0)


def ellipse(points: Floats) -> tuple[float, float, float]:
    """Return full width, full height and angle [deg] of the ellipse of one standard deviation of points (n, 2)."""
    variances, directions = np.linalg.eigh(np.cov(points, rowvar=False))
    width, height = 2 * np.sqrt(np.maximum(variances[::-1], 0.0))
    longest = directions[:, 1]
    return float(width), float(height), float(np.degrees(np.arctan2(longest[1], longest[0])))


def _cloud(axes: Axes, points: Floats, look: Look) -> None:
    if len(points) > 1:
        width, height, angle = ellipse(points)
        centre = (float(points[:, 0].mean()), float(points[:, 1].mean()))
        colours: dict[str, Any] = {
            "facecolor": (look.colour, 0.3),
            "edgecolor": style.mix(look.colour, style.BLACK, 0.35),
            "linestyle": look.line,
            "linewidth": 0.9,
        }
        axes.add_patch(Ellipse(centre, width, height, angle=angle, **colours))
    edge_of: dict[str, Any] = {"edgecolors": style.BLACK, "linewidths": 0.35}
    axes.scatter(points[:, 0], points[:, 1], s=14, marker=look.marker, color=look.colour, zorder=3, **edge_of)


def swarms(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw the swarm of each variant at a moment of a run with the figure's seed."""
    scenarios = {variant.label: variant.scenario for variant in study.sweep.variants}
    runs = {name: replace(scenarios[name], seed=settings.seed) for name in settings.variants or scenarios}
    return Drawing(swarm({name: snapshot(scenario, settings.at_s) for name, scenario in runs.items()}))


def panels(
    settings: FigureSettings,
    study: Study,
    evidence: Evidence,
    rows: pd.DataFrame,
    draw: Callable[[Axes, pd.DataFrame], None],
    handles: Sequence[Line2D],
    x_label: str,
) -> Drawing:
    """Draw a panel per level of the facet, with shared axes, and a legend below all panels."""
    facets = levels_in(rows, settings.facet, study) if settings.facet else [""]
    columns = min(len(facets), COLUMNS)
    lines = math.ceil(len(facets) / columns)
    legend_rows = math.ceil(len(handles) / 3)
    heights = lines_of(settings, evidence.runs)
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
            for words, value in heights.items():
                axes.axhline(value, color=style.BLACK, linewidth=0.7, linestyle=(0, (6, 3)), zorder=1)
                axes.annotate(words, (0.995, value), (0, 2), xycoords=axes.get_yaxis_transform(),
                              textcoords="offset points", ha="right", va="bottom")  # fmt: skip
        if (rows[settings.metric].min() >= 0) and not _has_metric_along_x(settings):
            grid[0, 0].set_ylim(bottom=0)
        for axes in grid[-1]:
            axes.set_xlabel(x_label)
        for axes in grid[:, 0]:
            axes.set_ylabel(study.metrics[settings.metric].label)
        if handles:
            figure.legend(handles=list(handles), loc="outside lower center", ncols=3, columnspacing=1.2)
    over = left_out(settings, study)
    note = f"Each value is the mean over {' and '.join(over)} within a replicate." if over else ""
    return Drawing(figure, (note,))


def lines_of(settings: FigureSettings, runs: pd.DataFrame) -> dict[str, float]:
    """Return the height of each line: a number, or the median of a variant; no line where that has no values."""
    medians = runs.groupby("variant")[settings.metric].median() if settings.metric in runs else pd.Series(dtype=float)
    heights = {name: medians.get(value) if isinstance(value, str) else value for name, value in settings.lines.items()}
    return {name: float(value) for name, value in heights.items() if value is not None and not pd.isna(value)}


def chosen(settings: FigureSettings, rows: pd.DataFrame, variants: Sequence[str]) -> pd.DataFrame:
    """Select the rows of these variants, in this order; of all, if there are none.

    Raises:
        ValueError: If there are no rows, or a metric has no values.
    """
    if rows.empty or (variants and not rows["variant"].isin(variants).any()):
        raise ValueError("there are no runs for it")
    if variants:
        rows = rows[rows["variant"].isin(variants)]
        order = {name: place for place, name in enumerate(variants)}
        rows = rows.sort_values("variant", key=lambda names: names.map(order), kind="stable")
    for metric in (settings.metric, *([settings.x] if _has_metric_along_x(settings) else [])):
        if metric not in rows or rows[metric].isna().all():
            raise ValueError(f"there are no values of {metric!r} to draw")
    return rows


def _has_metric_along_x(settings: FigureSettings) -> bool:
    return "x" in KINDS[settings.kind].metrics


def per_replicate(rows: pd.DataFrame, factors: Iterable[str], metrics: Sequence[str]) -> pd.DataFrame:
    """Average each replicate over the factors that a figure leaves out: their levels are no replicates."""
    shown = [name for name in dict.fromkeys(factors) if name]
    groups = rows.groupby([*shown, "replicate"], sort=False, as_index=False)[list(metrics)]
    return groups.agg(_mean_of_all)


def _mean_of_all(values: pd.Series) -> float:
    return float(values.mean(skipna=False))


def left_out(settings: FigureSettings, study: Study) -> list[str]:
    """List the titles of the factors over which a figure averages each replicate."""
    if settings.kind not in ("boxes", "levels", "plane"):
        return []
    shown = {settings.x, settings.hue, settings.facet}
    first: dict[tuple[str, ...], Mapping[str, str]] = {}
    found: set[str] = set()
    for variant in settings.variants or study.levels:
        levels = study.levels[variant]
        other = first.setdefault(tuple(level for name, level in levels.items() if name in shown), levels)
        found |= {name for name, level in levels.items() if level != other[name]}
    return [study.factor_title(name).partition(" [")[0] for name in study.factors if name in found]


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
