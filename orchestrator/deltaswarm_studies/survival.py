"""The time until a moment of events, by Kaplan and Meier, with SciPy's estimators.

Events of a run are not independent: one swarm serves them all. So the estimate is over all events of a variant, and
every interval is over runs: of a curve and its mean by the jackknife that leaves out one run at a time, of a difference
by the replicates' own differences. The log-rank test is done within each replicate, whose runs saw the same arrivals;
the signed-rank test over the replicates' statistics then says whether they agree.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats as scipy_stats
from scipy.stats import CensoredData, ecdf, logrank

from deltaswarm_orchestrator.results.outcome import Moment
from deltaswarm_studies import events as event_tables
from deltaswarm_studies.event_checks import MOMENTS, horizon_s
from deltaswarm_studies.event_settings import SurvivalSettings
from deltaswarm_studies.stats import ALPHA, DIFFERENCE, Contrast, Floats, contrast, holm
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import Row, end

ROUNDING = 1e-9
"""Shares that differ by less are equal but for rounding."""

QUANTILES = {"median": 0.5, "p95": 0.95}

GRID = 400
"""Steps of a curve for figures and of its band, over the horizon."""


def censored(times: pd.DataFrame) -> CensoredData:
    """Return the times of `events.until` as SciPy takes them."""
    return CensoredData.right_censored(times["time_s"].to_numpy(float), times["is_censored"].to_numpy(bool))


def mean_until_s(curve: Any, horizon_s: float) -> float:
    """Return the area under a survival function up to the horizon, the restricted mean [s].

    NaN if the last event was censored before the horizon, so that nobody knows the curve up to there.
    """
    jumps_s = curve.quantiles
    if not len(jumps_s) or (jumps_s[-1] < horizon_s and curve.probabilities[-1] > ROUNDING):
        return math.nan
    edges_s = np.array([0.0, *np.minimum(jumps_s, horizon_s), horizon_s])
    return float(np.sum(curve.evaluate(edges_s[:-1]) * np.diff(edges_s)))


def quantile_s(times_s: Floats, shares: Floats, quantile: float, horizon_s: float) -> float:
    """Return the first time at which at most this share is left [s]; inf if that is not reached within the horizon."""
    reached = np.nonzero((shares <= 1 - quantile + ROUNDING) & (times_s <= horizon_s))[0]
    return float(times_s[reached[0]]) if len(reached) else math.inf


@dataclass(frozen=True)
class Survival:
    """The times of one variant's events until a moment."""

    times: pd.DataFrame
    """Its events, as `events.until` returns them."""
    horizon_s: float

    @classmethod
    def of(cls, events: pd.DataFrame, variant: str, moment: Moment, horizon_s: float) -> "Survival":
        return cls(event_tables.until(event_tables.of_variant(events, variant), moment, horizon_s), horizon_s)

    @cached_property
    def curve(self) -> Any:
        """SciPy's survival function of all events."""
        return ecdf(censored(self.times)).sf

    @cached_property
    def runs(self) -> dict[int, pd.DataFrame]:
        by_number = self.times.groupby("replicate")
        return {number: by_number.get_group(number) for number in sorted(self.times["replicate"].unique().tolist())}

    @cached_property
    def _without(self) -> list[Any]:
        """The curve without each of the runs."""
        if len(self.runs) < 2:
            return []
        return [ecdf(censored(self.times[self.times["replicate"] != number])).sf for number in self.runs]

    def _error(self, values: Floats) -> Floats:
        """Return the standard error of estimates, from those without each of the runs (runs, ...)."""
        count = len(values)
        error: Floats = np.sqrt((count - 1) / count * np.sum((values - values.mean(axis=0)) ** 2, axis=0))
        return error

    @property
    def _errors(self) -> float:
        """Half the width of a 95 % interval, in standard errors; NaN with one run."""
        return float(scipy_stats.t.isf(ALPHA / 2, len(self.runs) - 1))

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the curve at these times, and the ends of its pointwise 95 % interval; NaN with one run."""
        share = np.asarray(self.curve.evaluate(times_s))
        half = np.full_like(share, np.nan)
        if self._without:
            half = self._errors * self._error(np.stack([curve.evaluate(times_s) for curve in self._without]))
        return share, np.maximum(share - half, 0.0), np.minimum(share + half, 1.0)

    @cached_property
    def band(self) -> pd.DataFrame:
        """The curve with its interval at evenly spaced times up to the horizon, for figures."""
        times_s = np.linspace(0.0, self.horizon_s, GRID + 1)
        share, low, high = self.at(times_s)
        return pd.DataFrame({"time_s": times_s, "share": share, "low": low, "high": high})

    def row(self) -> Row:
        """Describe the times: restricted mean, median and 95th percentile, each with its 95 % interval [s].

        A quantile is inf if it is not reached within the horizon; its interval is where the band meets the share.
        """
        mean_s = mean_until_s(self.curve, self.horizon_s)
        error = math.nan
        if self._without:
            error = float(self._error(np.array([mean_until_s(curve, self.horizon_s) for curve in self._without])))
        half = self._errors * error
        row: Row = {
            "runs": len(self.runs),
            "events": len(self.times),
            "came": int((~self.times["is_censored"]).sum()),
            "mean_s": mean_s,
            "mean_mcse_s": error,
            "mean_low_s": float(np.maximum(mean_s - half, 0.0)),
            "mean_high_s": float(np.minimum(mean_s + half, self.horizon_s)),
        }
        times_s = self.curve.quantiles
        for name, quantile in QUANTILES.items():
            for side, shares in zip(("", "_low", "_high"), self.at(times_s), strict=True):
                at_s = quantile_s(times_s, shares, quantile, self.horizon_s)
                row[f"{name}{side}_s"] = at_s if not side or self._without else math.nan
        return row

    def means_s(self) -> dict[int, float]:
        """Return the restricted mean of each replicate [s]."""
        return {number: mean_until_s(ecdf(censored(rows)).sf, self.horizon_s) for number, rows in self.runs.items()}


def log_rank(a: pd.DataFrame, b: pd.DataFrame) -> float:
    """Return SciPy's log-rank statistic of two samples of times: above 0 if `a` is sooner; NaN if nothing came."""
    if a["is_censored"].all() and b["is_censored"].all():
        return math.nan
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(logrank(censored(a), censored(b)).statistic)


def differences(a: Survival, b: Survival) -> tuple[Contrast, Contrast]:
    """Compare `a` with `b` within each replicate: restricted means [s], and log-rank statistics against 0."""
    shared = sorted(a.runs.keys() & b.runs.keys())
    means_a, means_b = a.means_s(), b.means_s()
    means = contrast([means_a[number] for number in shared], [means_b[number] for number in shared], DIFFERENCE)
    ranks = [log_rank(a.runs[number], b.runs[number]) for number in shared]
    return means, contrast(ranks, [0.0] * len(ranks), DIFFERENCE)


def families_in(survival: pd.DataFrame) -> list[int]:
    """Return the number of tests in each family of a study's tables `[[survival]]`."""
    if "difference_n" not in survival:
        return []
    sizes = survival[survival["difference_n"].notna()].groupby(["survival", "metric"]).size()
    return [int(size) for size in sizes for _ in ("means", "log-rank")]


def survival_of(study: Study, events: pd.DataFrame, unjudged: Collection[str] = ()) -> pd.DataFrame:
    """Make a row per table `[[survival]]` and variant that has events; see `Survival.row` and `differences`.

    Holm's correction is over the comparisons of a table, for the means and for the log-rank tests. The interval of a
    difference has the confidence at which Holm's procedure tests it. Unjudged variants are described and not compared.
    """
    return pd.DataFrame([row for settings in study.file.survival for row in _table(study, settings, events, unjudged)])


def _table(study: Study, settings: SurvivalSettings, events: pd.DataFrame, unjudged: Collection[str]) -> list[Row]:
    moment, followed_s = MOMENTS[settings.metric], horizon_s(study, settings)
    variants = dict.fromkeys([*(settings.variants or study.levels), *filter(None, [settings.reference])])
    present = set(events["variant"]) if len(events) else set()
    found = {name: Survival.of(events, name, moment, followed_s) for name in variants if name in present}
    head = {"survival": settings.text, "metric": settings.metric, "horizon_s": followed_s}
    rows = {name: {**head, "variant": name, **each.row()} for name, each in found.items()}
    compared = [name for name in found if name != settings.reference and name not in unjudged]
    if settings.reference not in found or settings.reference in unjudged:
        compared = []
    pairs = {name: differences(found[name], found[settings.reference]) for name in compared}
    for place, prefix in enumerate(("difference", "log_rank")):
        tests = holm([pair[place].p() for pair in pairs.values()])
        for (name, pair), (p_holm, alpha) in zip(pairs.items(), tests, strict=True):
            tested = pair[place]
            low, high = tested.interval(alpha)
            values = {"": tested.estimate, "_low": end(low), "_high": end(high)} if prefix == "difference" else {}
            own = {"": tested.estimate} if prefix == "log_rank" else {}
            rows[name] |= {f"{prefix}{side}": value for side, value in (values | own).items()}
            rows[name] |= {f"{prefix}_n": tested.n, f"{prefix}_p_holm": p_holm if tested.n else None}
    return list(rows.values())
