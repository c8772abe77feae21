"""Medians with intervals, comparisons with effect sizes, equivalence: scipy.stats does the reckoning.

Medians, because waiting times and message rates are skewed and runs are few. Intervals are bootstrap intervals, drawn
with a fixed seed: the same values always give the same report.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.analysis.intervals import (
    Array,
    bootstrap_interval,
    is_constant,
    ratio_of_medians,
    shift,
    shift_interval,
)
from deltaswarm_orchestrator.analysis.ranks import Alternative, RankTest, mann_whitney, wilcoxon

Values = Iterable[float | None]
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Description:
    """A sample in a few figures, all in the values' unit.

    With no value every figure is None. One value has a median and quartiles but no interval: it says nothing of its
    own spread. Values that are all equal have an interval of width 0.
    """

    n: int
    missing: int
    """How many values were None or NaN; they are in no figure."""
    median: float | None
    q1: float | None
    q3: float | None
    iqr: float | None
    mean: float | None
    low: float | None
    """Lower end of the bootstrap interval of the median."""
    high: float | None


@dataclass(frozen=True)
class Comparison:
    """How `a` differs from `b`; a positive difference or effect says that `a` is larger.

    Figures that the values cannot give are None; p is 1 where there is no evidence (no values, or all equal).
    """

    paired: bool
    n_a: int
    n_b: int
    """Paired, both are the number of pairs."""
    missing: int
    """Values that were None or NaN; paired, pairs of which either was."""
    test: str
    alternative: Alternative
    statistic: float | None
    """Paired, the rank sum of the pairs in which `a` is larger; else Mann-Whitney's U of `a`."""
    p: float
    median_a: float | None
    median_b: float | None
    difference: float | None
    """Hodges-Lehmann estimate of a - b, the shift that the test is about, in the values' unit."""
    low: float | None
    """Lower end of the difference's bootstrap interval."""
    high: float | None
    effect: float | None
    """From -1 (`a` always smaller) to 1 (`a` always larger)."""
    effect_name: str
    ratio: float | None
    """median(a) / median(b); None unless all values are above 0."""
    ratio_low: float | None
    ratio_high: float | None


@dataclass(frozen=True)
class Equivalence:
    """Two one-sided tests: a small `p` says that `a` and `b` differ by less than `margin`."""

    paired: bool
    n_a: int
    n_b: int
    margin: float
    test: str
    p: float
    difference: float | None
    """Hodges-Lehmann estimate of a - b."""
    low: float | None
    """Lower end of the difference's 90 % interval, the one that belongs to two tests at 5 %."""
    high: float | None


def describe(values: Values, *, confidence: float = CONFIDENCE, seed: int = 0) -> Description:
    """Describe a sample by its median, quartiles, mean, and the median's bootstrap interval.

    Args:
        values: The sample, in any unit; None and NaN are left out and counted.
        confidence: The interval's, between 0 and 1.
        seed: Of the resampling.

    Raises:
        ValueError: When a value is infinite, or the confidence is not between 0 and 1.
    """
    array, missing = _known(values)
    low, high = bootstrap_interval((array,), np.median, confidence=confidence, seed=seed, cost=len(array))
    if not len(array):
        return Description(0, missing, None, None, None, None, None, low, high)
    q1, q3 = (float(q) for q in np.quantile(array, (0.25, 0.75)))
    median = float(np.median(array))  # numpy's quantile may differ in the last digit, and the interval is the median's
    # A mean of equal values may be rounded beside them.
    mean = median if is_constant(array) else float(np.mean(array))
    return Description(len(array), missing, median, q1, q3, q3 - q1, mean, low, high)


def compare(
    a: Values,
    b: Values,
    *,
    paired: bool,
    alternative: Alternative = "two-sided",
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> Comparison:
    """Compare two samples by ranks.

    Paired, by Wilcoxon's signed-rank test, pairs that do not differ left out (`zero_method="wilcox"`), with the
    matched-pairs rank-biserial correlation; else by Mann-Whitney's U test, with Cliff's delta. Exact where that can
    be had, which `test` says.

    Args:
        a: One sample; None and NaN are left out (paired: with their pair) and counted.
        b: The other, in the same unit; paired, of the same length and order.
        paired: Whether a value of `a` and the one of `b` at its place saw the same arrivals.
        alternative: What the test looks for in `a`: "greater" or "less" than `b`, or either.
        confidence: The intervals', between 0 and 1.
        seed: Of the resampling.

    Raises:
        ValueError: When paired samples differ in length, a value is infinite, or the confidence is not between 0
            and 1.
    """
    first, second, missing = _samples(a, b, paired)
    found = wilcoxon(first - second, alternative) if paired else mann_whitney(first, second, alternative)
    low, high = shift_interval(first, second, paired, confidence, seed)
    ratio, (ratio_low, ratio_high) = ratio_of_medians(first, second, paired, confidence, seed)
    return Comparison(
        paired=paired,
        n_a=len(first),
        n_b=len(second),
        missing=missing,
        test=found.name,
        alternative=alternative,
        statistic=found.statistic,
        p=found.p,
        median_a=_median(first),
        median_b=_median(second),
        difference=shift(first, second, paired),
        low=low,
        high=high,
        effect=found.effect,
        effect_name=found.effect_name,
        ratio=ratio,
        ratio_low=ratio_low,
        ratio_high=ratio_high,
    )


def tost(a: Values, b: Values, margin: float, *, paired: bool, seed: int = 0) -> Equivalence:
    """Test whether `a` and `b` are equal but for `margin`: two one-sided rank tests, each shifted by the margin.

    Args:
        a: One sample; None and NaN are left out (paired: with their pair).
        b: The other, in the same unit; paired, of the same length and order.
        margin: The largest difference that is no difference, above 0, in the values' unit.
        paired: As for `compare`.
        seed: Of the resampling.

    Raises:
        ValueError: When the margin is not above 0, paired samples differ in length, or a value is infinite.
    """
    if not 0 < margin < math.inf:
        raise ValueError(f"the margin is {margin}; it must be above 0 and finite")
    first, second, _ = _samples(a, b, paired)
    above, below = _one_sided(first, second, -margin, paired), _one_sided(first, second, margin, paired)
    # Equivalence needs both, so the larger p counts.
    worse = max(above, below, key=lambda found: found.p)
    low, high = shift_interval(first, second, paired, 0.9, seed)
    between = shift(first, second, paired)
    return Equivalence(paired, len(first), len(second), margin, f"TOST by {worse.name}", worse.p, between, low, high)


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values, in the order given.

    By hand, for once: scipy has Benjamini-Hochberg and Benjamini-Yekutieli but not Holm, and statsmodels would be a
    large dependency for these lines. A test holds them to Holm's definition, the closure of Bonferroni's tests.

    Raises:
        ValueError: When a p-value is not between 0 and 1.
    """
    p = np.asarray(p_values, dtype=float)
    if not np.all((p >= 0) & (p <= 1)):
        raise ValueError("p-values are between 0 and 1")
    order = np.argsort(p, kind="stable")
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    return [float(value) for value in adjusted]


@dataclass(frozen=True)
class Samples:
    """One figure of two variants; paired, value by value with the same arrivals."""

    a: list[float]
    b: list[float]
    paired: bool


def samples(table: pd.DataFrame, figure: str, a: str, b: str) -> Samples:
    """One figure of two variants of a sweep's table.

    Paired where the replicates that both have ran with the same seeds; a replicate that only one has is then left
    out. Missing figures are NaN.

    Raises:
        ValueError: When the table lacks a variant or the figure, or a variant has a replicate twice.
    """
    first, second = _replicates(table, figure, a), _replicates(table, figure, b)
    shared = first.merge(second, left_index=True, right_index=True, suffixes=("_a", "_b")).sort_index()
    if len(shared) and (shared["seed_a"] == shared["seed_b"]).all():
        return Samples(shared["value_a"].tolist(), shared["value_b"].tolist(), paired=True)
    return Samples(first["value"].tolist(), second["value"].tolist(), paired=False)


def _replicates(table: pd.DataFrame, figure: str, variant: str) -> pd.DataFrame:
    """Seed and value by replicate."""
    for column in ("variant", "replicate", "seed", figure):
        if column not in table:
            raise ValueError(f"the table has no column {column!r}")
    rows = table[table["variant"] == variant]
    if rows.empty:
        raise ValueError(f"the table has no variant {variant!r}")
    if rows["replicate"].duplicated().any():
        raise ValueError(f"variant {variant!r} has a replicate twice")
    found = pd.DataFrame({"seed": rows["seed"], "value": pd.to_numeric(rows[figure])})
    return found.set_index(rows["replicate"])


def compare_all(table: pd.DataFrame, figure: str, reference: str, *, seed: int = 0) -> pd.DataFrame:
    """Compare each variant of a sweep's table with the reference variant.

    Returns:
        One row per variant but the reference, in the table's order, with the columns `variant`, `reference`,
        `p_holm` (adjusted over these rows) and every field of `Comparison`, where `a` is the variant and `b` the
        reference.

    Raises:
        ValueError: When the table lacks the reference or the figure, or a variant has a replicate twice.
    """
    _replicates(table, figure, reference)
    rows: list[dict[str, Any]] = []
    for variant in table["variant"].unique():
        if variant != reference:
            found = samples(table, figure, variant, reference)
            compared = compare(found.a, found.b, paired=found.paired, seed=seed)
            rows.append({"variant": variant, "reference": reference, **asdict(compared)})
    adjusted = holm([row["p"] for row in rows])
    columns = ["variant", "reference", "p_holm", *(field.name for field in fields(Comparison))]
    return pd.DataFrame([{**row, "p_holm": p} for row, p in zip(rows, adjusted, strict=True)], columns=columns)


def summarise(table: pd.DataFrame, figures: Sequence[str], *, seed: int = 0) -> pd.DataFrame:
    """Describe figures of each variant of a sweep's table.

    Returns:
        One row per variant and figure, in the table's order and that of `figures`: `variant`, `figure` and every
        field of `Description`.

    Raises:
        ValueError: When the table lacks a figure, or a variant has a replicate twice.
    """
    rows: list[dict[str, Any]] = []
    for variant in table["variant"].unique():
        for figure in figures:
            described = describe(_replicates(table, figure, variant)["value"], seed=seed)
            rows.append({"variant": variant, "figure": figure, **asdict(described)})
    return pd.DataFrame(rows, columns=["variant", "figure", *(field.name for field in fields(Description))])


def _all_values(values: Values) -> Array:
    array = np.array([math.nan if value is None or pd.isna(value) else float(value) for value in values], dtype=float)
    if np.isinf(array).any():
        raise ValueError("a value is infinite")
    return array


def _known(values: Values) -> tuple[Array, int]:
    array = _all_values(values)
    known = array[~np.isnan(array)]
    return known, len(array) - len(known)


def _samples(a: Values, b: Values, paired: bool) -> tuple[Array, Array, int]:
    """The values that take part, and how many are missing."""
    if not paired:
        (first, gone), (second, also_gone) = _known(a), _known(b)
        return first, second, gone + also_gone
    first, second = _all_values(a), _all_values(b)
    if len(first) != len(second):
        raise ValueError(f"paired samples have one length, not {len(first)} and {len(second)}")
    known = ~(np.isnan(first) | np.isnan(second))
    return first[known], second[known], int(np.sum(~known))


def _median(array: Array) -> float | None:
    return float(np.median(array)) if len(array) else None


def _one_sided(a: Array, b: Array, beyond: float, paired: bool) -> RankTest:
    """The test against a - b lying beyond a margin: at or below a negative one, at or above a positive one."""
    alternative: Alternative = "greater" if beyond < 0 else "less"
    return wilcoxon(a - b - beyond, alternative) if paired else mann_whitney(a - beyond, b, alternative)
