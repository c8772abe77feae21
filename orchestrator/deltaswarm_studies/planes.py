"""Figures with a metric along each axis: planes of all replicates, and frontiers of medians."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.scenario import content_of
from deltaswarm_studies import looks, style
from deltaswarm_studies.captions import averaged, n_of, notes, sizes_of
from deltaswarm_studies.charts import BOX_FROM, intervals, medians
from deltaswarm_studies.drawing import Drawing
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.labels import Label, place
from deltaswarm_studies.panels import (
    MANY,
    OUTLINE,
    Frame,
    chosen,
    handle,
    handles,
    hues,
    panels,
    per_replicate,
    whiskers,
)
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.stats import Floats
from deltaswarm_studies.study import Study, title_of
from deltaswarm_studies.style import Look


def plane(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw a point per replicate, and an ellipse of one standard deviation around the mean of each level of the hue."""
    metrics = [settings.x, settings.metric]
    shown = chosen(settings, study, evidence.means)
    factors = [settings.facet, settings.hue]
    rows = per_replicate(settings, study, shown).dropna(subset=metrics)
    look_of = hues(settings, study, rows)
    what, names = path_labels(study, settings.path)
    labels: list[Label] = []

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for hue, look in look_of.items():
            _cloud(axes, rows[rows[settings.hue] == hue][metrics].to_numpy(np.float64), look)
        of = shown.groupby("variant")[metrics].median()
        cells = set(map(tuple, rows[[name for name in factors if name]].to_numpy()))
        path = [name for name in settings.path if name in of.index and _cell(study, name, factors) in cells]
        joined = of.loc[path].to_numpy(np.float64)
        axes.plot(*joined.T, color=style.BLACK, linewidth=0.8, zorder=4)
        labels.extend(Label(axes, names[name], *at) for name, at in zip(path, joined, strict=True))

    legend = handles(study, settings.hue, look_of)
    if settings.path:
        legend.append(Line2D([], [], color=style.BLACK, linewidth=0.8, label=f"medians{what and f', by {what}'}"))
    title, x_title = study.legend_title(settings.hue), study.metrics[settings.x].label
    figure = panels(settings, study, evidence, rows, draw, Frame(x_title, legend, title, starts_at_zero=False))
    numbered = place(figure, labels)
    sizes = sizes_of(settings, study, rows, factors, metrics)
    told = f"A point per replicate, {n_of(sizes)}."
    if max(sizes.values()) >= BOX_FROM:
        told += " Ellipses span one standard deviation around the mean"
        told += "." if min(sizes.values()) >= BOX_FROM else f"; fewer than {BOX_FROM} points have none."
    notable = (*numbered, *_axes_from(figure.axes), *averaged(settings, study))
    return Drawing(figure, (told, *notable, *notes(settings, study, evidence, rows, sizes, factors)))


def frontier(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw the median of each variant with its 95 % intervals, and join those of each path; lower left is better."""
    metrics = [settings.x, settings.metric]
    groups = {**settings.paths, **{name: [name] for name in settings.variants}}
    variants = list(itertools.chain(*groups.values()))
    rows = chosen(settings, study, evidence.means, variants).dropna(subset=metrics)
    look_of = looks.of_groups(study, groups, are_paths=True)
    along = {name: path_labels(study, path) for name, path in settings.paths.items()}
    labels: list[Label] = []
    has_interval: list[bool] = []

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for name, members in groups.items():
            look, at = look_of[name], []
            for variant in members:
                replicates = rows[rows["variant"] == variant]
                if replicates.empty:
                    continue
                (x, y), low, high = medians((replicates[settings.x], replicates[settings.metric]))
                has_interval.append(not np.isnan(low).any())
                at.append((x, y))
                x_bars, y_bars = whiskers(np.array([x, y]), low, high).T.reshape(2, 2, 1)
                bars: dict[str, Any] = {"color": look.colour, "fmt": look.marker, "markersize": 4.5, "elinewidth": 0.6}
                axes.errorbar(x, y, y_bars, x_bars, **bars, **OUTLINE)
                if name in along:
                    labels.append(Label(axes, along[name][1][variant], x, y, style.mix(look.colour, style.BLACK, 0.3)))
            axes.plot(*np.array(at).reshape(-1, 2).T, color=look.colour, linestyle=look.line, linewidth=1.0, zorder=1)

    drawn = set(rows["variant"])
    legend = [
        handle(look, name if name in settings.paths else study.variant_title(name), line=name in settings.paths)
        for name, look in look_of.items()
        if drawn & set(groups[name])
    ]
    frame = Frame(study.metrics[settings.x].label, legend, starts_at_zero=False)
    figure = panels(settings, study, evidence, rows, draw, frame)
    numbered = place(figure, labels)
    sizes = {study.variant_title(name): int((rows["variant"] == name).sum()) for name in dict.fromkeys(variants)}
    told = [f"Medians of {n_of(sizes)} replicates, {intervals(has_interval)} along both axes."]
    if beside := [f"{what} of {name}" for name, (what, _) in along.items() if what]:
        told.append(f"Beside the points: {', '.join(beside)}.")
    return Drawing(
        figure,
        (
            *told,
            *numbered,
            *_axes_from(figure.axes),
            *notes(settings, study, evidence, rows, sizes, list(study.factors)),
        ),
    )


def path_labels(study: Study, path: Sequence[str]) -> tuple[str, dict[str, str]]:
    """Return what varies along a path of variants, and each variant's value of it, by their factors and scenarios.

    Where more than one thing varies, or nothing, the variants are called by their names.
    """
    factors = [
        factor for factor in study.factors if len({study.levels[name][factor] for name in path}) == len(path) > 1
    ]
    others = [factor for factor in study.factors if len({study.levels[name][factor] for name in path}) > 1]
    if len(study.factors) > 1 and factors == others and len(factors) == 1:
        [factor] = factors
        return study.factor_title(factor), {name: study.level_name(factor, study.levels[name][factor]) for name in path}
    scenarios = {variant.label: variant.scenario for variant in study.sweep.variants}
    contents = {name: dict(flattened(content_of(scenarios[name]))) for name in path}
    keys = dict.fromkeys(itertools.chain(*contents.values()))
    varying = [key for key in keys if len({str(content.get(key)) for content in contents.values()}) > 1]
    values = {name: str(content.get(varying[0])) for name, content in contents.items()} if varying else {}
    if len(varying) == 1 and len(set(values.values())) == len(path):
        return title_of(varying[0]), values
    return "", {name: study.variant_title(name) for name in path}


def _cell(study: Study, variant: str, factors: Sequence[str]) -> tuple[str, ...]:
    return tuple(study.levels[variant][name] for name in factors if name)


def _axes_from(panels: Sequence[Axes]) -> list[str]:
    """Say which axes do not begin at 0, since a reader may compare lengths from there."""
    ends = {"horizontal": panels[0].get_xlim()[0], "vertical": panels[0].get_ylim()[0]}
    cut = [name for name, end in ends.items() if end > 0]
    return [f"The {' and the '.join(cut)} axis {'do' if len(cut) > 1 else 'does'} not begin at 0."] if cut else []


def ellipse(points: Floats) -> tuple[float, float, float]:
    """Return full width, full height and angle [deg] of the ellipse of one standard deviation of points (n, 2)."""
    variances, directions = np.linalg.eigh(np.cov(points, rowvar=False))
    width, height = 2 * np.sqrt(np.maximum(variances[::-1], 0.0))
    longest = directions[:, 1]
    return float(width), float(height), float(np.degrees(np.arctan2(longest[1], longest[0])))


def _cloud(axes: Axes, points: Floats, look: Look) -> None:
    if len(points) >= BOX_FROM:
        width, height, angle = ellipse(points)
        centre = (float(points[:, 0].mean()), float(points[:, 1].mean()))
        colours: dict[str, Any] = {
            "facecolor": (look.colour, 0.3),
            "edgecolor": style.mix(look.colour, style.BLACK, 0.35),
            "linestyle": look.line,
            "linewidth": 0.9,
        }
        axes.add_patch(Ellipse(centre, width, height, angle=angle, **colours))
    dots: dict[str, Any] = {"s": 14, "color": look.colour, "edgecolors": style.BLACK, "linewidths": 0.35, "zorder": 3}
    if len(points) > MANY:
        dots |= {"s": 3, "linewidths": 0, "zorder": 1}
    axes.scatter(points[:, 0], points[:, 1], marker=look.marker, **dots)
