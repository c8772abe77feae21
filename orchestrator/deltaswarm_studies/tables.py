"""The tables of a study's runs: one row per run, window of time or estimate; and reports of missing values."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t

from deltaswarm_orchestrator.sweeps.table import InvalidRun, ranges
from deltaswarm_studies import metrics, montecarlo
from deltaswarm_studies.checks import used_metrics
from deltaswarm_studies.metrics import ID, WAITING, WAITING_ALL, StudyMetric, Timing
from deltaswarm_studies.stats import ALPHA, describe
from deltaswarm_studies.study import Study

Row = dict[str, Any]

INVALID = ("variant", "replicate", "means", "reason")
"""Columns of the table of runs that are no replicates."""

MAX_INVALID = 0.2
"""A variant is not judged if more than this share of its replicates is invalid."""

OF_RESULTS = (
    *("runs", "invalid", "courses", "recovery", "estimates", "contrasts", "claims", "fits", "grids"),
    *("events", "survival", "rings"),
)
OF_SENSITIVITY = ("points", "shares", "keys")
TABLES = (*OF_RESULTS, *OF_SENSITIVITY, "provenance")
"""Names of all tables beside a page."""

Samples = Callable[[str], pd.Series]
"""A function from a variant to its values of a metric by replicate."""

ORIGIN = {
    "digest": "digest",
    "events_digest": "events_digest",
    "arrival_times": "arrivals.times",
    "arrival_places": "arrivals.places",
}
"""Columns of a study's runs that identify what happened in them, with their columns in the sweep's table."""


def runs_of(study: Study, table: pd.DataFrame, series: pd.DataFrame) -> pd.DataFrame:
    """Make a row per run: columns that identify it, levels of factors, drawn keys, every metric that the study uses."""
    runs = with_levels(study, table[ID].assign(**{name: table.get(source) for name, source in ORIGIN.items()}))
    for one in study.ranges:
        runs[one.name] = table[one.name]
    for name in metrics_by_run(study):
        runs[name] = _values(study.metrics[name], table, series, study.timing).to_numpy()
    return runs


def by_point(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per variant and point of a sensitivity study: the means of its runs, where all of them have a value.

    The row has the point's number as `replicate`, and no digest. Other studies, and those with one run per point, keep
    their runs.
    """
    each, names = study.sweep.runs_per_point, metrics_by_run(study)
    if each == 1:
        return runs
    points = runs.drop(columns=[*ORIGIN], errors="ignore").assign(replicate=runs["replicate"] // each)
    groups = points.groupby(["variant", "replicate"], sort=False)
    measured = [name for name in names if name in points]
    complete = groups[measured].count() == each
    means = groups[measured].mean().where(complete)
    return groups.first().assign(**means).reset_index()[points.columns]


def with_levels(study: Study, rows: pd.DataFrame) -> pd.DataFrame:
    """Add each factor's level by the rows' variants."""
    of = {factor: {label: levels[factor] for label, levels in study.levels.items()} for factor in study.factors}
    return rows.assign(**{factor: rows["variant"].map(levels) for factor, levels in of.items()})


def planned_runs(study: Study) -> pd.DataFrame:
    """Make a row per run that the study plans: `variant`, `replicate`, each factor's level."""
    runs = [(label, number) for label, repeats in study.sweep.repeats.items() for number in range(repeats)]
    return with_levels(study, pd.DataFrame(runs, columns=["variant", "replicate"]))


def metrics_by_run(study: Study) -> list[str]:
    """List every metric that is computed for each run.

    Add the other waiting metric if only one is used, to see whether both agree; not if the study takes them over a part
    of the run only.
    """
    names = used_metrics(study)
    if {WAITING, WAITING_ALL} & set(names) and study.metrics[WAITING_ALL].kind == metrics.COLUMN:
        names += [WAITING, WAITING_ALL]
    return list(dict.fromkeys(names))


def _values(metric: StudyMetric, table: pd.DataFrame, series: pd.DataFrame, timing: Timing) -> pd.Series:
    if not metric.needs_series:
        if metric.column not in table:
            raise ValueError(f"the sweep's table has no column {metric.column!r}")
        return pd.to_numeric(table[metric.column])
    if series.empty or metric.series not in series:
        raise ValueError(f"{metric.title!r} needs a time series: sweep.series_every_s must be above 0")
    rows = series.assign(
        window=timing.index(series["time_s"]),
        value=timing.per_second(metric.of, series[metric.series], series["variant"]),
    )
    compute = _mean_within if metric.kind == metrics.WINDOW else _time_to_converge
    values = {run: compute(metric, group, timing) for run, group in rows.groupby(["variant", "replicate"])}
    return pd.Series([values.get(run, math.nan) for run in zip(table["variant"], table["replicate"], strict=True)])


def _mean_within(metric: StudyMetric, rows: pd.DataFrame, timing: Timing) -> float:
    """Average from `from_s` until `until_s`: means over events by event, others over time; count events."""
    inside = rows["window"] >= timing.windows(metric.from_s)
    if math.isfinite(metric.until_s):
        inside &= rows["window"] < timing.windows(metric.until_s)
    values, events = rows["value"][inside], rows["events_followed"][inside]
    if metric.of in metrics.COUNTS:
        return float(values.sum())
    if metric.of not in metrics.PER_EVENT:
        return float(values.mean())
    return float((values * events).sum()) / float(events.sum()) if events.sum() else math.nan


def _time_to_converge(metric: StudyMetric, rows: pd.DataFrame, timing: Timing) -> float:
    """Return when the running mean first reaches a share of the mean of the last third [s]; NaN if never."""
    ordered = rows.sort_values("window")
    times_s, values = ordered["time_s"].to_numpy(float), ordered["value"].to_numpy(float)
    width = max(1, timing.windows(metric.smooth_s))
    smooth = np.convolve(values, np.ones(width) / width, mode="valid")
    reached = np.nonzero(smooth >= metric.share * values[len(values) * 2 // 3 :].mean())[0]
    return float(times_s[reached[0] + width // 2]) if len(reached) else math.nan


def windows_with_levels(study: Study, series: pd.DataFrame) -> pd.DataFrame:
    """Make a row per run and window of time: run, `time_s`, `events`, every metric with a series, each factor's level.

    Means over events are over those that arrived in the window, other means over time. An incomplete last window is
    left out.
    """
    if series.empty:
        return with_levels(study, pd.DataFrame(columns=[*ID, "time_s", "events"]))
    window_s = study.file.study.window_s
    width = study.timing.windows(window_s)
    rows = series[ID].assign(window=study.timing.index(series["time_s"]) // width, events=series["events_followed"])
    recorded = {name: metric for name, metric in study.over_time.items() if metric.series in series}
    for name, metric in recorded.items():
        rows[name] = study.timing.per_second(name, series[metric.series], series["variant"])
    events = [name for name in recorded if name in metrics.PER_EVENT]
    rows[events] = rows[events].mul(rows["events"], axis=0).fillna(0.0)
    groups = rows.groupby([*ID, "window"], sort=False)
    sums = (*events, *metrics.COUNTS)
    windows = groups.agg({"events": "sum", **{name: "sum" if name in sums else "mean" for name in recorded}})
    windows[events] = windows[events].div(windows["events"].where(windows["events"] > 0), axis=0)
    whole = windows[groups.size() == width].reset_index()
    whole.insert(len(ID), "time_s", whole.pop("window") * window_s)
    # The last window of the series may itself be shorter than the others.
    inside = study.timing.is_within(whole["time_s"] + window_s, whole["variant"])
    return with_levels(study, whole[inside].reset_index(drop=True))


def courses_of(study: Study, windows: pd.DataFrame) -> pd.DataFrame:
    """Make a row per variant, window and metric drawn over time: the mean and its 95 % t-interval."""
    rows = []
    for name in dict.fromkeys(figure.metric for figure in study.file.figure if figure.kind == "time"):
        course = windows.groupby(["variant", *study.factors, "time_s"], sort=False)[name].agg(["count", "mean", "sem"])
        half = course.pop("sem") * t.ppf(1 - ALPHA / 2, np.maximum(course["count"] - 1, 1))
        course = course.assign(metric=name, low=course["mean"] - half, high=course["mean"] + half)
        rows.append(course.rename(columns={"count": "n"}).reset_index())
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame()


def estimates_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per variant and metric: median with interval and standard error, and quartiles."""
    rows: list[Row] = []
    for _, group in runs.groupby("variant", sort=False):
        for name in metrics_by_run(study):
            values, head = column(group, name), group.iloc[0][["variant", *study.factors]]
            rows.append({**head, "metric": name, **asdict(describe(values)), "mcse": montecarlo.of_median(values)})
    return pd.DataFrame(rows)


def column(runs: pd.DataFrame, metric: str) -> pd.Series:
    """Return a metric by row; without a value where the table, of an earlier study file, lacks it."""
    return runs[metric] if metric in runs else pd.Series(math.nan, index=runs.index)


def end(value: float) -> float | None:
    """Return an end of an interval for a table: None if it is infinite or not known."""
    return value if math.isfinite(value) else None


def samples_of(runs: pd.DataFrame, metric: str) -> Samples:
    """Return a function from a variant to its values of a metric by replicate; NaN where there is no run."""
    wide = runs.assign(value=column(runs, metric)).pivot(index="replicate", columns="variant", values="value")
    return lambda variant: wide[variant] if variant in wide else pd.Series(math.nan, index=wide.index)


def means_of(pairs: Sequence[tuple[pd.Series, pd.Series]]) -> tuple[pd.Series, pd.Series]:
    """Return the means of each pair's sides over the replicates that both have."""
    means = [pd.concat(pair, axis=1, keys=("a", "b")).dropna().mean() for pair in pairs]
    rows = pd.DataFrame(means, columns=["a", "b"]).reset_index(drop=True)
    return rows["a"], rows["b"]


def missing_runs(study: Study, runs: pd.DataFrame, invalid: pd.DataFrame) -> list[str]:
    """Say which runs of the study are not there and not known to be invalid; empty if there is no such run."""
    finished = {run for rows in (runs, invalid) for run in zip(rows["variant"], rows["replicate"], strict=True)}
    missing = {
        label: [replicate for replicate in range(repeats) if (label, replicate) not in finished]
        for label, repeats in study.sweep.repeats.items()
    }
    count, total = sum(map(len, missing.values())), sum(study.sweep.repeats.values())
    named = [f"{label} (replicates {ranges(replicates)})" for label, replicates in missing.items() if replicates]
    return [f"{count} of {total} runs are missing: {'; '.join(named)}."] if named else []


def invalid_of(runs: pd.DataFrame, invalid: Sequence[InvalidRun]) -> pd.DataFrame:
    """Make a row per run that is no replicate, without runs that were done by other means."""
    done = set(zip(runs["variant"], runs["replicate"], strict=True))
    rows = [row for row in invalid if (row["variant"], row["replicate"]) not in done]
    return pd.DataFrame(rows, columns=[*INVALID])


def too_few(study: Study, invalid: pd.DataFrame) -> dict[str, int]:
    """Return the variants of which nothing can be judged, with their number of valid replicates.

    Runs fail more often where something is special about them, so what is left is no sample of all.
    """
    counts = invalid["variant"].value_counts()
    lost = {label: int(counts.get(label, 0)) for label in study.levels}
    repeats = study.sweep.repeats
    return {label: repeats[label] - lost[label] for label in lost if lost[label] > MAX_INVALID * repeats[label]}


def missing_metrics(study: Study, runs: pd.DataFrame) -> list[str]:
    """Say which metrics of the study the table lacks, because it is of an earlier version of the study."""
    missing = [name for name in (*(one.name for one in study.ranges), *metrics_by_run(study)) if name not in runs]
    named = [f"{name} ({study.metrics[name].title})" if name in study.metrics else name for name in missing]
    return [f"The table of runs has no columns {', '.join(named)}."] if missing else []


def part_of_points(study: Study) -> list[str]:
    """Say that only some points of a sensitivity study are run; empty if all are."""
    sensitivity = study.sweep.file.sensitivity
    if not sensitivity or study.repeats == sensitivity.points:
        return []
    return [f"Only the first {study.repeats} of {sensitivity.points} points are run, so this is a look and no result."]


def same_arrivals(study: Study, runs: pd.DataFrame) -> list[str]:
    """Say, for the times and for the places of events, whether compared runs saw the same arrivals."""
    sides = {side for settings in study.file.contrast for row in study.comparisons(settings) for side in row.sides}
    sides |= {(claim.variants[0], claim.variants[1]) for claim in study.file.claim if len(claim.variants) == 2}
    clauses = []
    for name, what in (("arrival_times", "number and times"), ("arrival_places", "places")):
        if name not in runs or runs[name].isna().all():
            clauses.append(f"{what} of arrivals were not recorded")
            continue
        wide = runs.pivot(index="replicate", columns="variant", values=name)
        pairs = [wide[[a, b]].dropna() for a, b in sorted(sides) if a in wide and b in wide]
        total, equal = sum(map(len, pairs)), sum(int((pair.iloc[:, 0] == pair.iloc[:, 1]).sum()) for pair in pairs)
        clauses.append(f"{what} of arrivals are the same in {equal} of {total} pairs of runs that are compared")
    return clauses
