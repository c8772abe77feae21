"""The tables of a study's runs: a row per run, per window of time, per estimate; and what is missing in them."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t

from deltaswarm_orchestrator.significance import ALPHA
from deltaswarm_orchestrator.stats import describe
from deltaswarm_orchestrator.studies.checks import used_metrics
from deltaswarm_orchestrator.studies.metrics import ID, WAITING, WAITING_ALL, is_over_time
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_orchestrator.studies.values import values_of, windows_of

Row = dict[str, Any]

ORIGIN = {"digest": "digest", "arrival_times": "arrivals.times", "arrival_places": "arrivals.places"}
"""Columns of a study's runs that identify what happened in them, with their columns in the sweep's table."""


def runs_of(study: Study, table: pd.DataFrame, series: pd.DataFrame) -> pd.DataFrame:
    """Make a row per run: columns that identify it, the level of each factor, every metric that the study uses.

    Raises:
        ValueError: If the tables lack a column that a metric needs.
    """
    runs = table[ID].copy()
    for name, source in ORIGIN.items():
        runs[name] = table.get(source)
    for factor in study.factors:
        runs[factor] = runs["variant"].map({label: levels[factor] for label, levels in study.levels.items()})
    for name in metrics_by_run(study):
        runs[name] = values_of(study.metrics[name], table, series, study.timing).to_numpy()
    return runs


def metrics_by_run(study: Study) -> list[str]:
    """List every metric that is computed for each run.

    Add the other waiting metric if only one is used, to see whether both agree; not if the study takes them over a part
    of the run only.
    """
    names = used_metrics(study)
    if {WAITING, WAITING_ALL} & set(names) and not is_over_time([study.metrics[WAITING_ALL]]):
        names += [WAITING, WAITING_ALL]
    return list(dict.fromkeys(names))


def windows_with_levels(study: Study, series: pd.DataFrame) -> pd.DataFrame:
    """Make a row per run and time window, with each factor's level and every built-in metric that has a series."""
    windows = windows_of(series, study.file.study.window_s, study.timing)
    of = {factor: {label: levels[factor] for label, levels in study.levels.items()} for factor in study.factors}
    return windows.assign(**{factor: windows["variant"].map(levels) for factor, levels in of.items()})


def courses_of(study: Study, windows: pd.DataFrame) -> pd.DataFrame:
    """Make a row per variant, window and metric drawn over time: the mean and its 95 % t-interval."""
    rows = []
    for name in dict.fromkeys(figure.metric for figure in study.file.figure if figure.kind == "time"):
        found = windows.groupby(["variant", *study.factors, "time_s"], sort=False)[name].agg(["count", "mean", "sem"])
        half = found["sem"] * t.ppf(1 - ALPHA / 2, np.maximum(found["count"] - 1, 1))
        found = found.assign(metric=name, low=found["mean"] - half, high=found["mean"] + half)
        rows.append(found.drop(columns="sem").rename(columns={"count": "n"}).reset_index())
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame()


def estimates_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per variant and metric: median with interval, and quartiles."""
    rows: list[Row] = []
    metrics = metrics_by_run(study)
    for variant, own in runs.groupby("variant", sort=False):
        head = {"variant": variant, **{factor: own[factor].iloc[0] for factor in study.factors}}
        rows += [{**head, "metric": name, **asdict(describe(column(own, name)))} for name in metrics]
    return pd.DataFrame(rows)


def column(runs: pd.DataFrame, metric: str) -> pd.Series:
    """Return a metric by row; without a value where the table, of an earlier study file, lacks it."""
    return runs[metric] if metric in runs else pd.Series(math.nan, index=runs.index)


def end(value: float) -> float | None:
    """Return an end of an interval for a table: None if it is infinite or not known."""
    return value if math.isfinite(value) else None


def samples_of(runs: pd.DataFrame, metric: str) -> Callable[[str], pd.Series]:
    """Return a function from a variant to its values of a metric by replicate; NaN where there is no run."""
    wide = runs.assign(value=column(runs, metric)).pivot(index="replicate", columns="variant", values="value")
    return lambda variant: wide[variant] if variant in wide else pd.Series(math.nan, index=wide.index)


def missing_runs(study: Study, runs: pd.DataFrame) -> list[str]:
    """Say which runs of the study are not there; empty if all are."""
    there = set(zip(runs["variant"], runs["replicate"], strict=True))
    lacking = {
        label: [replicate for replicate in range(study.repeats) if (label, replicate) not in there]
        for label in study.levels
    }
    lacking = {label: replicates for label, replicates in lacking.items() if replicates}
    if not lacking:
        return []
    count, total = sum(map(len, lacking.values())), study.repeats * len(study.levels)
    named = [f"{label} (replicates {_ranges(replicates)})" for label, replicates in lacking.items()]
    return [f"{count} of {total} runs are missing: {'; '.join(named)}."]


def _ranges(numbers: Sequence[int]) -> str:
    """Shorten ascending numbers, such as 1, 2, 3, 7 to "1 to 3, 7"."""
    groups = itertools.groupby(enumerate(numbers), key=lambda pair: pair[1] - pair[0])
    runs = [[number for _, number in group] for _, group in groups]
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


def missing_metrics(study: Study, runs: pd.DataFrame) -> list[str]:
    """Say which metrics of the study the table lacks, because it is of an earlier version of the study."""
    lacking = [name for name in metrics_by_run(study) if name not in runs]
    return [f"The table of runs has no columns {', '.join(lacking)}."] if lacking else []


def same_arrivals(study: Study, runs: pd.DataFrame) -> list[str]:
    """Say, for the times and for the places of events, whether compared runs saw the same arrivals."""
    sides = {side for one in study.file.contrast for row in study.comparisons(one) for side in row.sides}
    sides |= {(claim.variants[0], claim.variants[1]) for claim in study.file.claim if len(claim.variants) == 2}
    found = []
    for name, what in (("arrival_times", "number and times"), ("arrival_places", "places")):
        if name not in runs or runs[name].isna().all():
            found.append(f"{what} of arrivals were not recorded")
            continue
        wide = runs.pivot(index="replicate", columns="variant", values=name)
        pairs = [(wide[a], wide[b]) for a, b in sorted(sides) if a in wide and b in wide]
        known = [(a[both], b[both]) for a, b in pairs for both in [a.notna() & b.notna()]]
        total, equal = sum(len(a) for a, _ in known), sum(int((a == b).sum()) for a, b in known)
        found.append(f"{what} of arrivals are the same in {equal} of {total} pairs of runs that are compared")
    return found
