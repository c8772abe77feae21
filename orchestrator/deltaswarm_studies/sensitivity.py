"""Where the claims of a sensitivity study hold: the share of points, and the keys on which that depends.

At a point every variant ran once with the same arrivals, or as often as the study says, of which the mean counts. At
each point a claim holds or does not, by the two sides there; so where they hardly differ, whether it holds is random.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats as scipy_stats

from deltaswarm_orchestrator.sweeps.sensitivity import RangeSettings, SensitivitySettings
from deltaswarm_studies import stats
from deltaswarm_studies.claim_settings import ClaimSettings
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import Row, samples_of

MIN_POINTS = 10
"""Least number of points for a rank correlation, whose p-value is approximate."""

TURNS, MOVES, NEITHER = "turns it", "changes its size", "not shown"
"""Whether a key decides if a claim holds, or only by how much; or neither is shown."""


class Feature(NamedTuple):
    """What is correlated: a range's number, or whether it has one of its choices."""

    key: str
    title: str
    """With the unit, or with the choice."""
    values: pd.Series
    """By point."""
    is_number: bool


@dataclass(frozen=True)
class Sensitivity:
    """The results of a sensitivity study, a table for each kind."""

    settings: SensitivitySettings
    points: pd.DataFrame
    """A row per point: `replicate`, the drawn keys, and of each claim `effect: ID` and `holds: ID`."""
    shares: pd.DataFrame
    """A row per claim: at how many points it holds, as a share with an exact 95 % interval."""
    keys: pd.DataFrame
    """A row per claim and feature: rank correlations with the effect and with whether the claim holds."""
    features: Sequence[Feature]
    ratios: frozenset[str]
    """Claims whose effect is a ratio of the two sides; of other orders it is their difference."""

    def strongest(self, claim: str) -> list[Feature]:
        """Return the features that are correlated most with a claim's effect, of each key one, the strongest first."""
        rows = self.keys[self.keys["claim"] == claim].dropna(subset="rho")
        rows = rows.sort_values("rho", key=np.abs, ascending=False, kind="stable").drop_duplicates("key")
        by_title = {feature.title: feature for feature in self.features}
        return [by_title[title] for title in rows["title"]]


def sensitivity_of(study: Study, runs: pd.DataFrame) -> Sensitivity | None:
    """Evaluate each claim at each point; return None unless it is a sensitivity study.

    `runs` have a column for each drawn key; without one the tables are of an earlier version of the study.
    """
    settings = study.sweep.file.sensitivity
    if settings is None or any(one.name not in runs for one in settings.range):
        return None
    points = runs.groupby("replicate")[[one.name for one in settings.range]].first()
    points = points.reindex(range(study.repeats))
    features = [feature for one in settings.range for feature in features_of(one, points[one.name])]
    shares, rows, ratios = [], [], set[str]()
    for claim in study.file.claim:
        found = at_points(claim, runs, study.repeats)
        if found.is_ratio:
            ratios.add(claim.id)
        points[f"effect: {claim.id}"], points[f"holds: {claim.id}"] = found.effect, found.holds
        shares.append(_share(claim, found))
        rows += [correlations(claim, feature, found.effect, found.holds) for feature in features]
    keys = pd.DataFrame(rows)
    tables = points.reset_index(), pd.DataFrame(shares), with_verdicts(keys)
    return Sensitivity(settings, *tables, features, frozenset(ratios))


class AtPoints(NamedTuple):
    """A claim at each point; NaN where a value is missing."""

    effect: pd.Series
    holds: pd.Series
    """1 or 0."""
    is_tie: pd.Series
    """1 or 0: whether the sides of an order differ by no more than rounding; then the claim does not hold."""
    is_ratio: bool


def at_points(claim: ClaimSettings, runs: pd.DataFrame, points: int) -> AtPoints:
    """Judge a claim at each point by itself.

    The effect is the value that the claim is about, or the ratio of its two sides; if some value is 0 or below, it is
    the difference at each point.
    """
    samples = samples_of(runs, claim.metric)
    values = [samples(name).reindex(range(points)).astype(float) for name in claim.variants]
    known = pd.concat(values, axis=1).notna().all(axis=1)
    is_tie, is_ratio = pd.Series(False, index=known.index), False
    if claim.kind == "value":
        effect, (low, high) = values[0], claim.region
        holds = (effect >= low) & (effect <= high)
    else:
        a, b = values if claim.kind == "alike" else values[::-1]  # an order names the side with less first
        is_ratio = stats.scale_of(a[known], b[known]) == stats.RATIO
        least = claim.at_least * b
        if claim.kind == "alike":
            expected = claim.ratio * b
            effect, holds = a - expected, (a <= claim.margin * expected) & (expected <= claim.margin * a)
        else:
            effect, rounding = a - least, stats.TIE * np.maximum(a.abs(), least.abs())
            holds, is_tie = effect > rounding, effect.abs() <= rounding
        effect = a / b if is_ratio else effect
    holds_at, is_tie_at = (one.astype(float).where(known) for one in (holds, is_tie))
    return AtPoints(effect.where(known), holds_at, is_tie_at, is_ratio)


def features_of(one: RangeSettings, values: pd.Series) -> list[Feature]:
    """Return a drawn key's values as numbers; of choices without an order, whether it has each; of two, the second."""
    if not one.choices:
        return [Feature(one.name, one.label, pd.to_numeric(values), True)]
    if all(_has_order(value) for value in one.choices.values()):
        return [Feature(one.name, one.label, values.map(one.choices), True)]
    names = list(one.choices)[1 if len(one.choices) == 2 else 0 :]
    return [
        Feature(
            one.name,
            f"{one.title}: {name}",
            (values == name).astype(float).where(values.isin(list(one.choices))),
            False,
        )
        for name in names
    ]


def features_in(ranges: Sequence[RangeSettings]) -> int:
    return sum(len(features_of(one, pd.Series(dtype=float))) for one in ranges)


def _has_order(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def share_interval(count: int, n: int) -> tuple[float, float]:
    """Return the exact 95 % interval of a share, by Clopper and Pearson."""
    if not n:
        return math.nan, math.nan
    interval = scipy_stats.binomtest(count, n).proportion_ci(1 - stats.ALPHA, method="exact")
    return float(interval.low), float(interval.high)


def _share(claim: ClaimSettings, found: AtPoints) -> Row:
    n, count, ties = (int(number) for number in (found.holds.notna().sum(), found.holds.sum(), found.is_tie.sum()))
    low, high = share_interval(count, n)
    head = {"claim": claim.id, "text": claim.text, "metric": claim.metric, "n": n, "missing": len(found.holds) - n}
    return {**head, "holds": count, "ties": ties, "share": count / n if n else math.nan, "low": low, "high": high}


def correlations(claim: ClaimSettings, feature: Feature, effect: pd.Series, holds: pd.Series) -> Row:
    """Make the row of a claim and a feature: their rank correlations, and the share of points at either end."""
    known = effect.notna() & feature.values.notna()
    values, effect, holds = feature.values[known], effect[known], holds[known]
    rho, p = rank_correlation(values, effect)
    rho_holds, p_holds = rank_correlation(values, holds)
    if feature.is_number:
        low, high = values.quantile([1 / 3, 2 / 3])
        ends = values <= low, values >= high
    else:
        ends = values == 0, values == 1
    few, many = (float(holds[end].mean()) if end.any() else math.nan for end in ends)
    head = {"claim": claim.id, "key": feature.key, "title": feature.title, "n": len(values)}
    return {
        **head,
        "rho": rho,
        "p": p,
        "rho_holds": rho_holds,
        "p_holds": p_holds,
        "share_low": few,
        "share_high": many,
    }


def rank_correlation(a: pd.Series, b: pd.Series) -> tuple[float, float]:
    """Return Spearman's correlation and its two-sided p-value; NaN with too few points, or if either does not vary."""
    if len(a) < MIN_POINTS or a.nunique() < 2 or b.nunique() < 2:
        return math.nan, math.nan
    result = scipy_stats.spearmanr(a, b)
    return float(result.statistic), float(result.pvalue)


def with_verdicts(keys: pd.DataFrame) -> pd.DataFrame:
    """Correct the p-values of all correlations together (Holm), and say what each key does to its claim."""
    for name in ("p", "p_holds"):
        keys[f"{name}_holm"] = math.nan
    tests = [(row, name) for name in ("p", "p_holds") for row in keys.index if not math.isnan(keys.loc[row, name])]
    for (row, name), (adjusted, _) in zip(tests, stats.holm([keys.loc[test] for test in tests]), strict=True):
        keys.loc[row, f"{name}_holm"] = adjusted
    turns, moves = keys["p_holds_holm"] <= stats.ALPHA, keys["p_holm"] <= stats.ALPHA
    return keys.assign(verdict=np.select([turns, moves], [TURNS, MOVES], NEITHER))


def tests_in(keys: pd.DataFrame) -> int:
    """Count the tests that are corrected together."""
    return int(keys[["p", "p_holds"]].notna().sum().sum())


def smallest_correlation(points: int, tests: int, power: float = 0.8) -> float:
    """Return the least rank correlation that points would show with a probability of `power` (Fisher's z)."""
    if points <= 3:
        return 1.0
    quantiles = scipy_stats.norm.isf(stats.ALPHA / tests / 2) + scipy_stats.norm.ppf(power)
    return math.tanh(float(quantiles) * math.sqrt(1.06 / (points - 3)))
