"""Statistics for sweeps: medians with intervals, paired contrasts, equivalence, Holm's correction.

All replicates of a sweep see the same arrivals in every variant, so every comparison is paired. A contrast estimates
the shift of the paired differences by Hodges and Lehmann; its interval is the set of shifts that the signed-rank test
does not reject, so interval and p-value cannot contradict each other. Where all values are positive the differences
are those of the logarithms, and the estimate is a ratio: 1.2 means "typically 1.2 times as large".
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
Values = Iterable[float | None]

ALPHA = 0.05
MAX_EXACT = 300
"""With more pairs, the normal approximation of the signed-rank distribution is used."""

RATIO: Literal["ratio"] = "ratio"
DIFFERENCE: Literal["difference"] = "difference"


@dataclass(frozen=True)
class Description:
    """A sample's median with its exact interval, and quartiles, in the values' unit; None where undefined."""

    n: int
    missing: int
    """Values that were None or NaN; they are left out."""
    median: float | None = None
    low: float | None = None
    """Lower end of the median's 95 % interval; None with fewer than 6 values, which cannot give one."""
    high: float | None = None
    q1: float | None = None
    q3: float | None = None


@dataclass(frozen=True)
class Contrast:
    """How `a` differs from `b`, pair by pair: a ratio above 1 or a difference above 0 means that `a` is larger."""

    scale: Literal["ratio", "difference"]
    n: int
    """Number of pairs."""
    missing: int
    """Pairs left out because a value was None or NaN."""
    estimate: float | None
    low: float | None
    """Lower end of the 95 % interval; None where there are too few pairs for one."""
    high: float | None
    p: float
    """Two-sided p-value of the signed-rank test; 1 if there is no evidence."""
    effect: float | None
    """Matched-pairs rank-biserial correlation, from -1 (`a` always smaller) to 1 (`a` always larger)."""
    p_alike: float | None = None
    """P-value of two one-sided tests (TOST): small if `a` and `b` differ by less than the margin."""
    p_beyond: float | None = None
    """P-value of the opposite: small if `a` and `b` differ by more than the margin."""


def describe(values: Values) -> Description:
    """Describe a sample. Its interval uses order statistics (scipy's `quantile_test`), so it assumes nothing."""
    array = _array(values)
    known = array[~np.isnan(array)]
    if not len(known):
        return Description(0, len(array))
    interval: Any = stats.quantile_test(known, q=float(np.median(known)), p=0.5).confidence_interval(1 - ALPHA)
    low, high = (None if math.isnan(end) else float(end) for end in (interval.low, interval.high))
    if low is None or high is None:
        low = high = None
    q1, median, q3 = (float(value) for value in np.quantile(known, (0.25, 0.5, 0.75)))
    return Description(len(known), len(array) - len(known), median, low, high, q1, q3)


def contrast(a: Values, b: Values, *, margin: float | None = None) -> Contrast:
    """Compare paired samples.

    Args:
        a: One value per replicate; a pair in which either value is None or NaN is left out.
        b: The values to compare with, in the same order.
        margin: The largest ratio that counts as no difference, above 1; not tested if the scale is a difference.

    Raises:
        ValueError: If the samples differ in length, a value is infinite, or the margin is impossible.
    """
    first, second = _array(a), _array(b)
    if len(first) != len(second):
        raise ValueError(f"paired samples must have the same length (got {len(first)} and {len(second)})")
    if margin is not None and not 1 < margin < math.inf:
        raise ValueError(f"the margin must be a finite ratio above 1 (got {margin})")
    known = ~(np.isnan(first) | np.isnan(second))
    missing = int(np.sum(~known))
    first, second = first[known], second[known]
    if not len(first):
        return Contrast(RATIO, 0, missing, None, None, None, 1.0, None)
    is_ratio = bool(np.all(first > 0) and np.all(second > 0))
    differences = np.log(first) - np.log(second) if is_ratio else first - second
    walsh = _walsh(differences)
    low, high = _interval(walsh, len(first))
    back = math.exp if is_ratio else float
    return Contrast(
        RATIO if is_ratio else DIFFERENCE,
        len(first),
        missing,
        back(float(np.median(walsh))),
        None if low is None else back(low),
        None if high is None else back(high),
        min(1.0, 2 * min(_p_greater(walsh, 0.0, len(first)), _p_less(walsh, 0.0, len(first)))),
        2 * _rank_sum(walsh) / len(walsh) - 1,
        *_equivalence(walsh, math.log(margin) if margin is not None and is_ratio else None, len(first)),
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Return Holm's adjusted p-values, in the order given; scipy does not have them."""
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    return [float(value) for value in adjusted]


def smallest_p(pairs: int) -> float:
    """Return the smallest two-sided p-value that this many pairs can give: all differences have the same sign."""
    return min(1.0, 2.0 ** (1 - pairs))


def pairs_needed(family: int) -> int:
    """Return the minimum number of pairs for a test to become significant in a family of `family` tests (Holm)."""
    return next(pairs for pairs in range(1, 200) if smallest_p(pairs) * family < ALPHA)


def _array(values: Values) -> Array:
    array = np.array([math.nan if value is None else float(value) for value in values], dtype=float)
    if np.isinf(array).any():
        raise ValueError("values must be finite (got an infinite one)")
    return array


def _walsh(differences: Array) -> Array:
    """Return the sorted means of all pairs of differences, including each with itself."""
    i, j = np.triu_indices(len(differences))
    return np.sort((differences[i] + differences[j]) / 2)


def _rank_sum(walsh: Array) -> float:
    """Return the signed-rank statistic: the number of Walsh averages above 0; those at 0 count half."""
    return float(np.sum(walsh > 0) + np.sum(walsh == 0) / 2)


def _p_greater(walsh: Array, shift: float, pairs: int) -> float:
    """Return the one-sided p-value against "the shift is at most this"; ties count for the null hypothesis."""
    return _tail(int(np.sum(walsh > shift)), pairs)


def _p_less(walsh: Array, shift: float, pairs: int) -> float:
    """Return the one-sided p-value against "the shift is at least this"; ties count for the null hypothesis."""
    return _tail(int(np.sum(walsh < shift)), pairs)


def _tail(statistic: int, pairs: int) -> float:
    """Return the probability under the null hypothesis of a signed-rank statistic at least this large."""
    total = pairs * (pairs + 1) // 2
    if pairs > MAX_EXACT:
        spread = math.sqrt(pairs * (pairs + 1) * (2 * pairs + 1) / 24)
        return float(stats.norm.sf((statistic - 0.5 - total / 2) / spread))
    return float(_null_distribution(pairs)[statistic:].sum())


def _null_distribution(pairs: int) -> Array:
    """Return the probabilities (n (n + 1) / 2 + 1,) of all signed-rank statistics under the null hypothesis."""
    found = np.ones(1)
    for rank in range(1, pairs + 1):
        longer = np.zeros(len(found) + rank)
        longer[: len(found)] += found / 2
        longer[rank:] += found / 2
        found = longer
    return found


def _interval(walsh: Array, pairs: int) -> tuple[float | None, float | None]:
    """Return the range of shifts that the two-sided test does not reject at ALPHA; None if it rejects none."""
    total = len(walsh)
    tails = np.array([_tail(total - cut, pairs) for cut in range(total // 2 + 1)])
    cut = int(np.sum(tails <= ALPHA / 2))  # number of Walsh averages rejected at each end
    return (None, None) if cut == 0 else (float(walsh[cut - 1]), float(walsh[total - cut]))


def _equivalence(walsh: Array, limit: float | None, pairs: int) -> tuple[float | None, float | None]:
    """Return the p-values of "within the margin" and of "beyond the margin"."""
    if limit is None:
        return None, None
    within = max(_p_greater(walsh, -limit, pairs), _p_less(walsh, limit, pairs))
    return within, min(1.0, 2 * min(_p_greater(walsh, limit, pairs), _p_less(walsh, -limit, pairs)))
