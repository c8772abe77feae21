"""A column of `series.csv` over time by variant: the paper's number of agents in trees, for 25 and 100 agents."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from deltaswarm_orchestrator.figures import style
from deltaswarm_orchestrator.figures.tables import REPLICATE, TIME_S, VARIANT, Floats, require, variants_of

IN_TREES = "agents_in_trees"
IN_TREES_LABEL = "mean number of agents in trees"

RESAMPLES = 1000


def over_time(
    series: pd.DataFrame,
    column: str = IN_TREES,
    label: str = IN_TREES_LABEL,
    *,
    variants: Sequence[str] | None = None,
    references: Mapping[str, float] | None = None,
    fault_s: float | None = None,
    fault_until_s: float | None = None,
    confidence: float = 0.95,
    width_in: float = style.TEXT_IN,
    height_in: float = 2.7,
) -> Figure:
    """Mean across replicates over time, with its bootstrap interval (the paper's figure of agents in trees).

    Each window of the table is one point, in the middle of the window; nothing is smoothed beyond that. The
    band is the percentile bootstrap interval of the mean across replicates, window by window, from a fixed
    seed; with one replicate there is none. A window without a value in some replicate counts the others,
    one without any leaves a gap, and the legend says from how many replicates the mean is.

    Args:
        series: one row per run and window, with `variant`, `replicate`, `time_s` (the window's start) and `column`.
        column: what to draw.
        label: of its axis, with the unit.
        variants: which, in this order; all, in order of appearance, by default.
        references: horizontal dashed lines by what is written beside them, such as `{"paper: 12": 12}`.
        fault_s: where a vertical line marks a fault [s].
        fault_until_s: where the grey area ends that marks how long it lasted [s].
        confidence: of the band.
        width_in: width [in].
        height_in: height [in].

    Raises:
        ValueError: a column or variant that is not there, a variant without any value, or a replicate with two
            rows for one window.
    """
    require(series, VARIANT, REPLICATE, TIME_S, column)
    chosen = variants_of(series, variants)
    with style.drawing():
        figure = style.new_figure(width_in, height_in)
        axes = figure.add_subplot()
        end_s, least = 0.0, np.inf
        for variant, look in style.looks(chosen).items():
            starts_s, length_s, windows = _windows(series, variant, column)
            _line(axes, starts_s + length_s / 2, windows, look, style.shown(variant), confidence)
            end_s = max(end_s, float(starts_s[-1]) + length_s)
            least = min(least, float(np.nanmin(windows)))
        axes.set_xlim(0.0, end_s or None)
        _mark(axes, references or {}, fault_s, fault_until_s)
        if least >= 0:
            axes.set_ylim(bottom=0.0)  # last: it keeps the top where it is, which must hold the references too
        axes.set_xlabel("time [s]")
        axes.set_ylabel(label)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2, columnspacing=1.2)
    return figure


def _windows(series: pd.DataFrame, variant: str, column: str) -> tuple[Floats, float, Floats]:
    """The windows' starts (w,) and length [s], and the column's values (w, replicates), NaN where there is none."""
    rows = series[series[VARIANT] == variant]
    if rows.duplicated([REPLICATE, TIME_S]).any():
        raise ValueError(f"variant {variant!r} has more than one row for one replicate and window")
    wide = rows.pivot_table(index=TIME_S, columns=REPLICATE, values=column, dropna=False).sort_index()
    values = wide.to_numpy(dtype=np.float64, na_value=np.nan)
    if not np.isfinite(values).any():
        raise ValueError(f"variant {variant!r} has no value of {column} in {values.shape[1]} runs")
    starts_s = wide.index.to_numpy(dtype=np.float64)
    length_s = float(np.min(np.diff(starts_s))) if len(starts_s) > 1 else 0.0
    return starts_s, length_s, values


def _line(axes: Axes, times_s: Floats, windows: Floats, look: style.Look, name: str, confidence: float) -> None:
    means, lows, highs, counts = [], [], [], []
    for window in windows:
        there = window[np.isfinite(window)]
        low, high = interval(there, confidence)
        means.append(float(there.mean()) if len(there) else np.nan)
        lows.append(low)
        highs.append(high)
        counts.append(len(there))
    fewest, most = min(counts), max(counts)
    count = f"n = {most}" if fewest == most else f"n = {fewest} to {most}"
    axes.fill_between(times_s, lows, highs, color=look.colour, alpha=0.25, linewidth=0)
    axes.plot(times_s, means, color=look.colour, linestyle=look.line, label=f"{name}, {count}")


def interval(values: Floats, confidence: float) -> tuple[float, float]:
    """Percentile bootstrap interval of the mean of values (n,); NaN for fewer than two."""
    if len(values) < 2:
        return np.nan, np.nan
    if np.ptp(values) == 0:
        return float(values[0]), float(values[0])
    found = stats.bootstrap(
        (values,),
        np.mean,
        n_resamples=RESAMPLES,
        confidence_level=confidence,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(found.low), float(found.high)


def _mark(axes: Axes, references: Mapping[str, float], fault_s: float | None, fault_until_s: float | None) -> None:
    for name, value in references.items():
        axes.axhline(value, color=style.BLACK, linewidth=0.7, linestyle=(0, (6, 3)), zorder=1)
        axes.annotate(
            name, (1.0, value), (3, 0), xycoords=axes.get_yaxis_transform(), textcoords="offset points", va="center"
        )
    if fault_s is not None and fault_until_s is not None:
        axes.axvspan(fault_s, fault_until_s, color=style.PALE, alpha=0.5, linewidth=0, zorder=0)
    if fault_s is not None:
        axes.axvline(fault_s, color=style.BLACK, linewidth=0.9, linestyle=(0, (1, 1.5)))
        axes.annotate(
            f"fault at {fault_s:g} s",
            (fault_s, 1.0),
            (3, -3),
            xycoords=axes.get_xaxis_transform(),
            textcoords="offset points",
            va="top",
        )
