"""Operator messages against messages within the swarm: the paper's figure of the delta sensitivity analysis."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from deltaswarm_orchestrator.figures import style
from deltaswarm_orchestrator.figures.tables import VARIANT, Floats, counted, of_variant, require, variants_of

FRAMES_SENT, FRAMES_RECEIVED = "frames_sent_per_s.mean", "frames_received_per_s.mean"
OPERATOR_MESSAGES = "operator_messages_per_s.mean"

AXES = {
    FRAMES_SENT: "inter-swarm messages sent per s",
    FRAMES_RECEIVED: "inter-swarm messages received per s",
    OPERATOR_MESSAGES: "messages to the operator per s",
}
"""Labels of the columns that this figure is made for; any other column is labelled by its name."""

POINT_SIZES_PT2 = (26.0, 9.0)
"""From the first variant's points to the last's: a high delta is decentralised to the message, and must not hide it."""


def messages(
    table: pd.DataFrame,
    x: str = FRAMES_SENT,
    y: str = OPERATOR_MESSAGES,
    *,
    variants: Sequence[str] | None = None,
    width_in: float = style.TEXT_IN,
    height_in: float = 3.0,
) -> Figure:
    """One point per replicate and, per variant, an ellipse of one standard deviation around the mean.

    The ellipse's half axes are the square roots of the eigenvalues of the replicates' covariance (n - 1), along its
    eigenvectors; with one replicate there is none. A replicate without a value is left out, and the legend
    counts it.

    Args:
        table: one row per run, with `variant`, `x` and `y`.
        x: column of the horizontal axis: the paper's "messages within the swarm", read as frames sent.
        y: column of the vertical axis.
        variants: which, in this order; all, in order of appearance, by default.
        width_in: width [in].
        height_in: height [in].

    Raises:
        ValueError: a column or variant that is not there, or a variant without any value.
    """
    require(table, VARIANT, x, y)
    chosen = variants_of(table, variants)
    with style.drawing():
        figure = style.new_figure(width_in, height_in)
        axes = figure.add_subplot()
        handles = []
        sizes = np.linspace(*POINT_SIZES_PT2, len(chosen)).tolist()
        for size, (variant, look) in zip(sizes, style.looks(chosen).items(), strict=True):
            rows, runs = of_variant(table, variant, x, y)
            name = style.shown(variant)
            _draw(axes, rows, look, size)
            handles.append(_handle(look, name if len(rows) == runs else f"{name}\n({counted(len(rows), runs)})"))
        axes.set_xlabel(AXES.get(x, x))
        axes.set_ylabel(AXES.get(y, y))
        axes.grid(True, color=style.PALE, linewidth=0.5)
        axes.set_axisbelow(True)
        axes.margins(0.06)
        figure.legend(handles=handles, loc="outside right center")
    return figure


def ellipse(points: Floats) -> tuple[float, float, float]:
    """Width and height (whole axes) and angle [deg] of the ellipse of one standard deviation of points (n, 2)."""
    variances, directions = np.linalg.eigh(np.cov(points, rowvar=False))
    width, height = 2 * np.sqrt(np.maximum(variances[::-1], 0.0))
    longest = directions[:, 1]
    return float(width), float(height), float(np.degrees(np.arctan2(longest[1], longest[0])))


def _draw(axes: Axes, points: Floats, look: style.Look, size_pt2: float) -> None:
    if len(points) > 1:
        width, height, angle = ellipse(points)
        x, y = points.mean(axis=0)
        axes.add_patch(
            Ellipse(
                (float(x), float(y)),
                width,
                height,
                angle=angle,
                facecolor=(look.colour, 0.3),
                edgecolor=style.mix(look.colour, style.BLACK, 0.35),
                linestyle=look.line,
                linewidth=0.9,
            )
        )
    axes.scatter(
        points[:, 0],
        points[:, 1],
        s=size_pt2,
        marker=look.marker,
        color=look.colour,
        edgecolors=style.BLACK,
        linewidths=0.35,
        zorder=3,
    )


def _handle(look: style.Look, name: str) -> Line2D:
    return Line2D(
        [],
        [],
        linestyle=look.line,
        linewidth=0.9,
        marker=look.marker,
        color=look.colour,
        markersize=4.5,
        markeredgecolor=style.BLACK,
        markeredgewidth=0.35,
        label=name,
    )
