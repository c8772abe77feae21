"""Figures along a factor (boxes, levels), over time, and of the swarm at a moment."""

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from deltaswarm_studies import looks, style
from deltaswarm_studies.captions import averaged, n_of, notes, sizes_of
from deltaswarm_studies.drawing import Drawing
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.panels import MANY, Frame, chosen, handles, hues, levels_in, panels, per_replicate, points
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.stats import Floats, describe
from deltaswarm_studies.study import Study
from deltaswarm_studies.style import Look
from deltaswarm_studies.swarm import snapshot, swarm

BOX_FROM = 5
"""Fewest values for a box or an ellipse; with fewer there are only points, since it would say no more than they do."""

MOST_UPRIGHT = 7
"""With more categories than this in a row of panels, the names under the axis are rotated."""

LETTERS_TURNED = 40
"""A name of more letters is upright."""

BOX_IN = 0.26
"""Least width of a box with the space around it [in]."""

FEW_BANDS = 3
"""With more bands than this that overlap, panels over time are as wide as the page."""

LETTERS_PER_IN = 18
"""Letters of an axis label that are side by side in an inch."""


def boxes(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw one box per level of the factor `x` (and of the hue), with a point per replicate."""
    shown = chosen(settings, study, evidence.means)
    factors = [settings.facet, settings.x, settings.hue]
    rows = per_replicate(settings, study, shown)
    levels = levels_in(settings, study, settings.x)
    look_of = looks.of_levels(study, settings.hue or settings.x)
    colours = list(hues(settings, study, rows)) if settings.hue else levels
    frame = Frame(
        study.factor_title(settings.x),
        [*(handles(study, settings.hue, {name: look_of[name] for name in colours}, line=False)), *_published(settings)],
        study.legend_title(settings.hue),
        BOX_IN * len(levels) * (len(colours) if settings.hue else 1),
    )

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
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
        _categories(axes, [study.level_name(settings.x, level) for level in levels])

    sizes = sizes_of(settings, study, rows, factors, [settings.metric])
    told = f"A point per replicate, {n_of(sizes)}."
    if max(sizes.values()) >= BOX_FROM:
        told += (
            " Boxes span the quartiles, with the median as a line and whiskers to the farthest value within 1.5 "
            f"interquartile ranges{'' if min(sizes.values()) >= BOX_FROM else f'; fewer than {BOX_FROM} have none'}."
        )
    figure = panels(settings, study, evidence, rows, draw, frame)
    return Drawing(figure, (told, *averaged(settings, study), *notes(settings, study, evidence, rows, sizes, factors)))


def levels(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw medians with exact 95 % intervals along a factor: at its levels' numbers if they have any, else evenly."""
    shown = chosen(settings, study, evidence.means)
    factors = [settings.facet, settings.x, settings.hue]
    rows = per_replicate(settings, study, shown)
    names = levels_in(settings, study, settings.x)
    places = study.numbers(settings.x)
    at = {name: places[name] if places else float(index) for index, name in enumerate(names)}
    ordered = sorted(names, key=at.__getitem__)
    look_of = hues(settings, study, rows)
    apart = (0.012 if places else 0.06) * ((max(at.values()) - min(at.values()) or 1.0) if places else 1.0)
    has_interval = []

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for index, (hue, look) in enumerate(look_of.items()):
            group = rows[rows[settings.hue] == hue] if hue else rows
            middle, low, high = medians(group[group[settings.x] == name][settings.metric] for name in ordered)
            has_interval.extend(~np.isnan(low[~np.isnan(middle)]))
            x = np.array([at[name] for name in ordered]) + apart * (index - (len(look_of) - 1) / 2)
            points(axes, x, middle, low, high, look)
        if not places:
            _categories(axes, [study.level_name(settings.x, name) for name in names])

    legend = handles(study, settings.hue, look_of)
    frame = Frame(study.factor_title(settings.x), legend, study.legend_title(settings.hue))
    figure = panels(settings, study, evidence, rows, draw, frame)
    sizes = sizes_of(settings, study, rows, factors, [settings.metric])
    told = f"Medians of {n_of(sizes)} replicates, {intervals(has_interval)}."
    told += " Points are set slightly apart along the axis." if len(look_of) > 1 else ""
    return Drawing(figure, (told, *averaged(settings, study), *notes(settings, study, evidence, rows, sizes, factors)))


def time(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw means over the replicates with 95 % intervals, each over its window of time."""
    courses = evidence.courses
    if len(courses):
        courses = courses[courses["metric"] == settings.metric].rename(columns={"mean": settings.metric})
    rows = chosen(settings, study, courses)
    look_of = hues(settings, study, rows)
    window_s = study.file.study.window_s

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for hue, look in look_of.items():
            group = (rows[rows[settings.hue] == hue] if hue else rows).sort_values("time_s")
            if group.empty:
                continue
            edges = np.array([*group["time_s"], group["time_s"].iloc[-1] + window_s])
            line: dict[str, Any] = {"color": look.colour, "linestyle": look.line, "linewidth": 1.2}
            axes.stairs(group[settings.metric], edges, baseline=None, **line)
            band: dict[str, Any] = {"color": look.colour, "alpha": 0.2, "linewidth": 0, "fill": True}
            axes.stairs(group["high"], edges, baseline=group["low"], **band)
        facet = str(rows[settings.facet].iloc[0]) if settings.facet and len(rows) else ""
        for span in settings.spans:
            if span.levels and facet not in span.levels:
                continue
            until_s = span.from_s if span.until_s is None else span.until_s
            axes.axvspan(span.from_s, until_s, color=style.GREY, alpha=0.15, linewidth=0.9, zorder=0)
            place: dict[str, Any] = {"xycoords": axes.get_xaxis_transform(), "textcoords": "offset points"}
            axes.annotate(style.shown(span.text), (span.from_s, 1.0), (3, -3), va="top", **place)
        axes.margins(x=0)

    legend = handles(study, settings.hue, look_of, marker=False)
    frame = Frame("Time [s]", legend, study.legend_title(settings.hue), 1.3 if len(look_of) <= FEW_BANDS else 2.5)
    figure = panels(settings, study, evidence, rows, draw, frame)
    sizes = {
        study.variant_title(name): int(rows[rows["variant"] == name]["n"].max() if name in set(rows["variant"]) else 0)
        for name in settings.variants or study.levels
    }
    windows = {str(place): int(n) for place, n in enumerate(rows["n"])}
    told = f"Means over {n_of(windows)} replicates, drawn over the windows of {window_s:g} s that they are of"
    told += (
        ", with 95 % intervals (Student's t)." if max(windows.values()) > 1 else ", without intervals, which need 2."
    )
    return Drawing(figure, (told, *notes(settings, study, evidence, rows, sizes, list(study.factors))))


def swarms(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw the swarm of each variant at a moment of a run with the figure's seed."""
    scenarios = {variant.label: variant.scenario for variant in study.sweep.variants}
    runs = {name: replace(scenarios[name], seed=settings.seed) for name in settings.variants or scenarios}
    shots = {study.variant_title(name): snapshot(scenario, settings.at_s) for name, scenario in runs.items()}
    return Drawing(swarm(shots), (f"One run each (seed {settings.seed}), at {settings.at_s:g} s.",))


def medians(samples: Iterable[pd.Series]) -> Floats:
    """Return the median, and the lower and upper end of its interval, of each sample (3, n); NaN where undefined."""
    described = [(sample.median, sample.low, sample.high) for sample in map(describe, samples)]
    return np.array(described, dtype=np.float64).T


def intervals(has_interval: Sequence[bool]) -> str:
    """Say what the whiskers of medians are."""
    if not any(has_interval):
        return "without intervals, which need 6"
    return "with exact 95 % intervals" + ("" if all(has_interval) else " where there are at least 6")


def _published(settings: FigureSettings) -> list[Line2D]:
    label = "published median, with half its interquartile range to either side"
    look: dict[str, Any] = {"linestyle": "none", "marker": "D", "color": style.BLACK, "markersize": 3.2}
    return [Line2D([], [], label=label, **look)] if settings.published else []


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
    dots: dict[str, Any] = {
        "s": 9,
        "marker": look.marker,
        "facecolors": "white" if len(values) >= BOX_FROM else look.colour,  # else nothing has the level's colour
        "edgecolors": style.BLACK,
        "linewidths": 0.5,
    }
    if len(values) > MANY:
        dots |= {"s": 2, "marker": "o", "facecolors": style.BLACK, "linewidths": 0, "alpha": 0.4}
    axes.scatter(place + spread * width * 0.6, values, zorder=3, **dots)


def _categories(axes: Axes, names: Sequence[str]) -> None:
    """Write the names of categories below the axis: in lines between words, or rotated if a word is too long."""
    subplot = axes.get_subplotspec()
    columns = subplot.get_gridspec().ncols if subplot else 1
    room = int((style.TEXT_IN - 0.5) / columns / len(names) * LETTERS_PER_IN)
    longest = max(len(word) for name in names for word in name.split() or [""])
    turned = longest > room or len(names) * columns > MOST_UPRIGHT * columns
    words = [style.shown(name) for name in names]
    upright = turned and max(map(len, words)) > LETTERS_TURNED
    if not turned:
        words = ["\n".join(textwrap.wrap(text, room, break_long_words=False)) for text in words]
    elif upright:
        lines = max(1, int((style.TEXT_IN - 0.5) / columns / len(names) / style.LINE_IN))
        width = max(LETTERS_TURNED, -(-max(map(len, words)) // lines) + 5)
        words = ["\n".join(textwrap.wrap(text, width)) for text in words]
    angle = 90 if upright else 40 if turned else 0
    axes.set_xticks(range(len(names)), words, rotation=angle, ha="right" if turned else "center")
    if turned:
        for label in axes.get_xticklabels():
            label.set_rotation_mode("anchor")
            if upright:
                label.set_verticalalignment("center")
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.tick_params(axis="x", length=0)
