"""Compute metrics from a sweep's tables: for each run, and for each window of time."""

import math

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.studies.metrics import (
    BUILT_IN,
    COLUMN,
    COUNTS,
    FOLLOWED,
    ID,
    PER_EVENT,
    WINDOW,
    Metric,
    Timing,
)


def windows_of(series: pd.DataFrame, window_s: float, timing: Timing) -> pd.DataFrame:
    """Make a row per run and window of `window_s` seconds: run, `time_s`, `events`, every metric with a series.

    Means over events are over those that arrived in the window, other means over time. An incomplete last window is
    left out.
    """
    if series.empty:
        return pd.DataFrame(columns=[*ID, "time_s", "events"])
    width = timing.windows(window_s)
    rows = series[ID].assign(window=timing.index(series["time_s"]) // width, events=series[FOLLOWED])
    there = {name: metric for name, metric in BUILT_IN.items() if metric.series in series and metric.series}
    for name, metric in there.items():
        rows[name] = timing.per_second(name, series[metric.series], series["variant"])
    events = [name for name in there if name in PER_EVENT]
    rows[events] = rows[events].mul(rows["events"], axis=0).fillna(0.0)
    groups = rows.groupby([*ID, "window"], sort=False)
    sums = (*events, *COUNTS)
    found = groups.agg({"events": "sum", **{name: "sum" if name in sums else "mean" for name in there}})
    found[events] = found[events].div(found["events"].where(found["events"] > 0), axis=0)
    whole = found[groups.size() == width].reset_index()
    whole.insert(len(ID), "time_s", whole.pop("window") * window_s)
    # The last window of the series may itself be shorter than the others.
    return whole[timing.is_within(whole["time_s"] + window_s, whole["variant"])].reset_index(drop=True)


def values_of(metric: Metric, table: pd.DataFrame, series: pd.DataFrame, timing: Timing) -> pd.Series:
    """Compute the metric for each row of the table.

    Raises:
        ValueError: If the table or the series lacks a column.
    """
    if metric.kind == COLUMN:
        if metric.column not in table:
            raise ValueError(f"the sweep's table has no column {metric.column!r}")
        return pd.to_numeric(table[metric.column])
    if series.empty or metric.series not in series:
        raise ValueError(f"{metric.title!r} needs a time series: sweep.series_every_s must be above 0")
    rows = series.assign(
        window=timing.index(series["time_s"]),
        value=timing.per_second(metric.of, series[metric.series], series["variant"]),
    )
    find = _mean_within if metric.kind == WINDOW else _time_to_converge
    found = {run: find(metric, own, timing) for run, own in rows.groupby(["variant", "replicate"])}
    return pd.Series([found.get(run, math.nan) for run in zip(table["variant"], table["replicate"], strict=True)])


def _mean_within(metric: Metric, rows: pd.DataFrame, timing: Timing) -> float:
    """Average from `from_s` until `until_s`: means over events by event, others over time; count events."""
    inside = rows["window"] >= timing.windows(metric.from_s)
    if math.isfinite(metric.until_s):
        inside &= rows["window"] < timing.windows(metric.until_s)
    values, events = rows["value"][inside], rows[FOLLOWED][inside]
    if metric.of in COUNTS:
        return float(values.sum())
    if metric.of not in PER_EVENT:
        return float(values.mean())
    return float((values * events).sum()) / float(events.sum()) if events.sum() else math.nan


def _time_to_converge(metric: Metric, rows: pd.DataFrame, timing: Timing) -> float:
    """Return when the running mean first reaches a share of the mean of the last third [s]; NaN if never."""
    ordered = rows.sort_values("window")
    times_s, values = ordered["time_s"].to_numpy(float), ordered["value"].to_numpy(float)
    width = max(1, timing.windows(metric.smooth_s))
    smooth = np.convolve(values, np.ones(width) / width, mode="valid")
    reached = np.nonzero(smooth >= metric.share * values[len(values) * 2 // 3 :].mean())[0]
    return float(times_s[reached[0] + width // 2]) if len(reached) else math.nan
