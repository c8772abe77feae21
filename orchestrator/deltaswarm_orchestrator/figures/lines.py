"""A figure of the runs against a swept number, such as the radio's loss, one line per group; no figure of the paper."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from deltaswarm_orchestrator.figures import style
from deltaswarm_orchestrator.figures.tables import Floats, require

DODGE = 0.008
"""Lines stand apart by this share of the axis, so that no whisker hides another."""


def lines(
    table: pd.DataFrame,
    key: str,
    x_label: str,
    y_label: str,
    *,
    group: str = "control.mode",
    groups: Sequence[str] | None = None,
    width_in: float = style.COLUMN_IN,
    height_in: float = 2.5,
) -> Figure:
    """One line per group through `value`, with whiskers from `low` to `high`.

    Lines stand slightly apart sideways (DODGE), so that whiskers can be told apart. Where `low` or `high` is
    NaN there is no whisker.

    Args:
        table: one row per group and value of the key, with the columns `key`, `group`, `value`, `low` and `high`.
        key: column of the swept number, the horizontal axis.
        x_label: its label, with the unit.
        y_label: label of `value`, with the unit.
        group: column that tells the lines apart.
        groups: which, in this order; all, in order of appearance, by default.
        width_in: width [in].
        height_in: height [in].

    Raises:
        ValueError: a column or group that is not there, two rows for one point, a key or value that is no
            finite number, or an interval that does not hold its value.
    """
    require(table, key, group, "value", "low", "high")
    chosen = [str(name) for name in table[group].unique()] if groups is None else list(groups)
    if not chosen:
        raise ValueError("no groups are asked for")
    lines_of = {name: _points(table, name, key, group) for name in chosen}
    keys = np.concatenate([points[:, 0] for points in lines_of.values()])
    apart = float(np.ptp(keys)) * DODGE
    with style.drawing():
        figure = style.new_figure(width_in, height_in)
        axes = figure.add_subplot()
        for place, (name, look) in enumerate(style.looks(chosen).items()):
            _line(axes, lines_of[name], apart * (place - (len(chosen) - 1) / 2), look, style.shown(name))
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.grid(True, color=style.PALE, linewidth=0.5)
        axes.set_axisbelow(True)
        figure.legend(loc="outside upper center", ncols=min(len(chosen), 3), columnspacing=1.2)
    return figure


def _points(table: pd.DataFrame, name: str, key: str, group: str) -> Floats:
    """Key, value, low and high (n, 4) of one group, by key. Raises ValueError as `lines` says."""
    own = table.loc[table[group].astype(str) == name, [key, "value", "low", "high"]]
    points = own.sort_values(key).to_numpy(dtype=np.float64, na_value=np.nan)
    if not len(points):
        raise ValueError(f"{group} {name!r} has no rows")
    if not np.isfinite(points[:, :2]).all():
        raise ValueError(f"{group} {name!r}: {key} and value must be finite numbers in every row")
    if len(np.unique(points[:, 0])) < len(points):
        raise ValueError(f"{group} {name!r} has more than one row for one {key}")
    if (points[:, 2] > points[:, 1]).any() or (points[:, 3] < points[:, 1]).any():
        raise ValueError(f"{group} {name!r}: low <= value <= high is expected in every row")
    return points


def _line(axes: Axes, points: Floats, apart: float, look: style.Look, name: str) -> None:
    keys, values, lows, highs = points.T
    axes.errorbar(
        keys + apart,
        values,
        yerr=np.stack([values - lows, highs - values]),
        color=look.colour,
        linestyle=look.line,
        marker=look.marker,
        markersize=4.5,
        markeredgecolor=style.BLACK,
        markeredgewidth=0.4,
        capsize=2,
        elinewidth=0.8,
        label=name,
    )
