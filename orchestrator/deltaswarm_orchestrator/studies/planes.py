"""Figures with a metric along each axis: clouds of replicates, and the frontier of what variants reach."""

import itertools
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.patheffects import withStroke

from deltaswarm_orchestrator.report.plots import style
from deltaswarm_orchestrator.report.plots.style import Look
from deltaswarm_orchestrator.stats import Description, describe
from deltaswarm_orchestrator.studies.panels import chosen, handles, hues, or_nan, panels
from deltaswarm_orchestrator.studies.settings import FigureSettings
from deltaswarm_orchestrator.studies.study import Study

Floats = npt.NDArray[np.float64]

HALO = withStroke(linewidth=2, foreground="white")


def plane(settings: FigureSettings, study: Study, runs: pd.DataFrame) -> Figure:
    """Draw a point per replicate, and an ellipse of one standard deviation around the mean of each level of the hue."""
    shown = chosen(settings, runs, settings.variants)
    look_of = hues(settings, study, shown)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for hue, look in look_of.items():
            points = rows[rows[settings.hue] == hue][[settings.x, settings.metric]].dropna().to_numpy(np.float64)
            _cloud(axes, points, look)
        medians = rows.groupby("variant")[[settings.x, settings.metric]].median()
        path = [name for name in settings.path if name in medians.index]
        joined = medians.loc[path].to_numpy(np.float64)
        axes.plot(*joined.T, color=style.BLACK, linewidth=0.8, zorder=4)
        for name, (x_at, y_at) in zip(path, joined, strict=True):
            number = style.delta_of(name)
            words = name if number is None else str(number)
            axes.annotate(words, (x_at, y_at), (4, 3), textcoords="offset points", zorder=5, path_effects=[HALO])

    return panels(settings, study, shown, draw, handles(look_of), study.metrics[settings.x].label)


def frontier(settings: FigureSettings, study: Study, runs: pd.DataFrame) -> Figure:
    """Draw the median of each variant with its 95 % intervals, and join those of each path; lower left is better."""
    shown = chosen(settings, runs, [*settings.variants, *itertools.chain(*settings.paths.values())])
    named = style.looks([*settings.paths, *settings.variants], repeat=True)

    def draw(axes: Axes, rows: pd.DataFrame) -> None:
        for name in (*settings.paths, *settings.variants):
            found = [_median_of(rows, settings, variant) for variant in settings.paths.get(name, [name])]
            points, look = [point for point in found if point is not None], named[name]
            marks: dict[str, Any] = {"fmt": look.marker, "markeredgecolor": style.BLACK, "markeredgewidth": 0.4}
            for point in points:
                errors = _whiskers(point.y), _whiskers(point.x)
                axes.errorbar(*point.at, *errors, color=look.colour, markersize=4.5, elinewidth=0.6, **marks)
                if name in settings.paths:
                    number = point.variant.rpartition(" ")[2]
                    axes.annotate(number, point.at, (4, 3), textcoords="offset points", zorder=5, path_effects=[HALO])
            path = np.array([point.at for point in points]).reshape(-1, 2)
            axes.plot(*path.T, color=look.colour, linestyle=look.line, linewidth=1.0, zorder=1)

    return panels(settings, study, shown, draw, handles(named), study.metrics[settings.x].label)


class _Point(NamedTuple):
    variant: str
    x: Description
    y: Description

    @property
    def at(self) -> tuple[float, float]:
        """The medians."""
        return or_nan(self.x.median), or_nan(self.y.median)


def _median_of(rows: pd.DataFrame, settings: FigureSettings, variant: str) -> _Point | None:
    own = rows[rows["variant"] == variant]
    x, y = describe(own[settings.x]), describe(own[settings.metric])
    return _Point(variant, x, y) if x.n and y.n else None


def _whiskers(found: Description) -> Floats:
    """Return the lengths (2, 1) of an interval below and above the median; none where there is no interval."""
    ends = (found.low, found.high)
    return np.array([[0.0 if end is None else abs(end - or_nan(found.median))] for end in ends])


def ellipse(points: Floats) -> tuple[float, float, float]:
    """Return full width, full height and angle [deg] of the ellipse of one standard deviation of points (n, 2)."""
    variances, directions = np.linalg.eigh(np.cov(points, rowvar=False))
    width, height = 2 * np.sqrt(np.maximum(variances[::-1], 0.0))
    longest = directions[:, 1]
    return float(width), float(height), float(np.degrees(np.arctan2(longest[1], longest[0])))


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
