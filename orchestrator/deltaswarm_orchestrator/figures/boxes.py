"""Box plots of one figure of a run by variant: the paper's waiting times for 25 agents, and its ablation study."""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from deltaswarm_orchestrator.figures import style
from deltaswarm_orchestrator.figures.tables import VARIANT, Floats, counted, of_variant, require, variants_of

WAITING = "waiting_time_s.mean"
WAITING_LABEL = "mean waiting time [s]"

UPRIGHT_AT_MOST = 6
"""With more variants the boxes lie, since their names would not fit side by side."""

BOX_WIDTH, JITTER_WIDTH, PAPER_OFFSET = 0.5, 0.34, 0.37
"""As shares of the distance between two boxes."""

MEDIAN_PT = 1.6


def boxes(
    table: pd.DataFrame,
    column: str = WAITING,
    label: str = WAITING_LABEL,
    *,
    variants: Sequence[str] | None = None,
    paper: Mapping[str, tuple[float, float]] | None = None,
    width_in: float = style.TEXT_IN,
    height_in: float | None = None,
) -> Figure:
    """Box plot with one box per variant and one point per replicate (the paper's figures of waiting times).

    Boxes span the quartiles with the median as a line, whiskers reach the farthest replicate within 1.5
    interquartile ranges. A replicate without a value is left out, and the label counts it.

    Args:
        table: one row per run, with `variant` and `column`.
        column: the figure of a run to draw.
        label: of its axis, with the unit.
        variants: which, in this order; all, in order of appearance, by default.
        paper: median and interquartile range by variant, drawn beside the boxes: a diamond at the median, and
            bars that are one interquartile range long in all, as a box is, since the quartiles are not given.
        width_in: width [in].
        height_in: height [in]; by the number of variants by default.

    Raises:
        ValueError: a column or variant that is not there, or a variant without any value.
    """
    require(table, VARIANT, column)
    chosen = variants_of(table, variants)
    lie = len(chosen) > UPRIGHT_AT_MOST
    with style.drawing():
        figure = style.new_figure(width_in, height_in or (0.7 + 0.3 * len(chosen) if lie else 2.7))
        axes = figure.add_subplot()
        names = []
        for place, (variant, look) in enumerate(style.looks(chosen, repeat=True).items(), start=1):
            rows, runs = of_variant(table, variant, column)
            _box(axes, rows[:, 0], place, look, lie=lie)
            names.append(_name(variant, counted(len(rows), runs), 1000 if lie else round(66 / len(chosen))))
        _beside(axes, chosen, paper or {}, lie=lie)
        _finish(axes, names, label, lie=lie)
    return figure


def jitter(count: int) -> Floats:
    """Offsets (count,) within -0.5 and 0.5 that spread points evenly and are the same each time: golden ratio."""
    spread: Floats = (np.arange(1, count + 1) * (5**0.5 - 1) / 2) % 1.0 - 0.5
    return spread


def _box(axes: Axes, values: Floats, place: float, look: style.Look, *, lie: bool) -> None:
    """Draw box, whiskers and points; not by `Axes.boxplot`, which loads pyplot and so looks for a display."""
    found = boxplot_stats(values)[0]
    half = BOX_WIDTH / 2

    def line(across: Sequence[float], along: Sequence[float], colour: str, width_pt: float) -> None:
        axes.plot(*((along, across) if lie else (across, along)), color=colour, linewidth=width_pt, zorder=2.5)

    low, size = (place - half, found["q1"]), (BOX_WIDTH, found["q3"] - found["q1"])
    corner, sides = (low[::-1], size[::-1]) if lie else (low, size)
    axes.add_patch(Rectangle(corner, *sides, facecolor=look.tint, edgecolor=look.colour, hatch=look.hatch, zorder=2))
    for near, far in ((found["q1"], found["whislo"]), (found["q3"], found["whishi"])):
        line([place, place], [near, far], style.GREY, 0.8)
        line([place - half / 2, place + half / 2], [far, far], style.GREY, 0.8)
    line([place - half, place + half], [found["med"]] * 2, style.BLACK, MEDIAN_PT)
    across = place + jitter(len(values)) * JITTER_WIDTH
    points = (values, across) if lie else (across, values)
    axes.scatter(*points, s=9, marker=look.marker, facecolors="white", edgecolors=style.BLACK, linewidths=0.5, zorder=3)


def _beside(axes: Axes, variants: Sequence[str], paper: Mapping[str, tuple[float, float]], *, lie: bool) -> None:
    given = [(place, *paper[variant]) for place, variant in enumerate(variants, start=1) if variant in paper]
    if not given:
        return
    places, medians, ranges = (np.array(values, dtype=np.float64) for values in zip(*given, strict=True))
    beside, half = places + PAPER_OFFSET, ranges / 2
    axes.errorbar(
        *((medians, beside) if lie else (beside, medians)),
        xerr=half if lie else None,
        yerr=None if lie else half,
        fmt="D",
        color=style.BLACK,
        markersize=3.2,
        capsize=2,
        elinewidth=0.8,
        label="paper: median, interquartile range",
    )
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, handlelength=1.2)


def _name(variant: str, count: str, room: int) -> str:
    name = style.shown(variant)
    lines = [name] if "$" in name else textwrap.wrap(name, max(room, 8), break_long_words=False)
    return "\n".join([*lines, count]) if room < 1000 else f"{name}, {count}"


def _finish(axes: Axes, names: Sequence[str], label: str, *, lie: bool) -> None:
    across, along = (axes.yaxis, axes.xaxis) if lie else (axes.xaxis, axes.yaxis)
    across.set_ticks(range(1, len(names) + 1), names)
    across.set_tick_params(length=0)
    along.set_label_text(label)
    along.grid(True, color=style.PALE, linewidth=0.5)
    axes.set_axisbelow(True)
    ends = (0.4, len(names) + 0.6)
    if lie:
        axes.set_ylim(ends[1], ends[0])
    else:
        axes.set_xlim(*ends)
