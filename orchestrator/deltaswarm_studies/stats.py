"""Statistics for sweeps: medians with intervals, paired contrasts, Holm's correction, the power of a plan.

Variants of a sweep see the same arrivals, so comparisons are paired by replicate. A contrast estimates the shift of the
paired differences by Hodges and Lehmann; its interval is the set of shifts that the signed-rank test does not reject,
so interval and p-value cannot contradict each other. Where all values are positive the differences are those of the
logarithms, and the estimate is a ratio: 1.2 means "typically 1.2 times as large".

SciPy is imported where it is needed: `--plan` works without it.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

ALPHA = 0.05

Floats = NDArray[np.float64]
Values = Iterable[float | None]
Interval = tuple[float, float]
"""Lower and upper end; infinite where there are too few values for an end."""

MAX_EXACT = 300
"""With more pairs, the normal approximation of the signed-rank distribution is used."""

TIE = 1e-9
"""Values that differ by a smaller share are equal but for rounding."""

SIGNED_RANK_EFFICIENCY = 3 / math.pi
"""Of the signed-rank test relative to the t-test, for normal differences."""

MEDIAN_ERROR = 1.2533 / 1.349
"""Standard error of a normal sample's median, in units of its interquartile range over the root of its size."""

Scale = Literal["ratio", "difference"]
RATIO: Scale = "ratio"
DIFFERENCE: Scale = "difference"

NOWHERE: Interval = (-math.inf, math.inf)


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

    scale: Scale
    n: int
    """Number of pairs."""
    missing: int
    """Pairs left out because a value was None or NaN."""
    estimate: float | None
    effect: float | None
    """Matched-pairs rank-biserial correlation, from -1 (`a` always smaller) to 1 (`a` always larger)."""
    _walsh: Floats = field(repr=False, compare=False)

    @property
    def none(self) -> float:
        """The value of no difference."""
        return 1.0 if self.scale == RATIO else 0.0

    def interval(self, alpha: float) -> Interval:
        """Return the shifts that the two-sided test at `alpha` does not reject."""
        if not self.n:
            return NOWHERE
        total = len(self._walsh)
        cut = rejected_walsh(self.n, alpha)
        if cut == 0:
            return NOWHERE
        return self._back(float(self._walsh[cut - 1])), self._back(float(self._walsh[total - cut]))

    def p(self, null: float | None = None) -> float:
        """Return the two-sided p-value against "it is typically `null`", by default no difference; 1 without pairs."""
        return min(1.0, 2 * min(self.p_above(null), self.p_below(null)))

    def p_above(self, null: float | None = None) -> float:
        """Return the one-sided p-value against "it is typically at most `null`"."""
        return _tail(int(np.sum(self._walsh > self._shift(null) + self._tie)), self.n)

    def p_below(self, null: float | None = None) -> float:
        """Return the one-sided p-value against "it is typically at least `null`"."""
        return _tail(int(np.sum(self._walsh < self._shift(null) - self._tie)), self.n)

    def p_within(self, margin: float) -> float:
        """Return the two-sided p-value of "the ratio is within a margin above 1": two one-sided tests.

        It is at most alpha exactly where the interval at alpha lies within the margin.
        """
        return min(1.0, 2 * max(self.p_above(1 / margin), self.p_below(margin)))

    def p_beyond(self, margin: float) -> float:
        """Return the two-sided p-value of the opposite, in which the interval lies entirely beyond the margin."""
        return min(1.0, 2 * min(self.p_above(margin), self.p_below(1 / margin)))

    @property
    def _tie(self) -> float:
        return TIE if self.scale == RATIO else 0.0

    def _shift(self, null: float | None) -> float:
        value = self.none if null is None else null
        return math.log(value) if self.scale == RATIO else value

    def _back(self, shift: float) -> float:
        return math.exp(shift) if self.scale == RATIO else shift


@dataclass(frozen=True)
class MeanContrast(Contrast):
    """The same on average: by the mean of the differences, or of the ratios' logarithms, with Student's t."""

    error: float
    """Standard error of the mean; NaN of a single pair."""

    def interval(self, alpha: float) -> Interval:
        from scipy import stats

        if self.n < 2:
            return NOWHERE
        shift, half = self._shift(self.estimate), float(stats.t.isf(alpha / 2, self.n - 1)) * self.error
        return self._back(shift - half), self._back(shift + half)

    def p_above(self, null: float | None = None) -> float:
        return self._beyond(self._shift(self.estimate) - self._shift(null))

    def p_below(self, null: float | None = None) -> float:
        return self._beyond(self._shift(null) - self._shift(self.estimate))

    def _beyond(self, distance: float) -> float:
        from scipy import stats

        if self.n < 2:
            return 1.0
        return float(stats.t.sf(distance / self.error, self.n - 1)) if self.error else float(distance <= 0)


def describe(values: Values) -> Description:
    """Describe a sample. Its interval uses order statistics, so it assumes nothing."""
    array = _array(values)
    known = array[~np.isnan(array)]
    if not len(known):
        return Description(0, len(array))
    ends = [None if math.isinf(end) else end for end in median_interval(known, ALPHA)]
    low, high = ends if None not in ends else (None, None)
    q1, median, q3 = (float(value) for value in np.quantile(known, (0.25, 0.5, 0.75)))
    return Description(len(known), len(array) - len(known), median, low, high, q1, q3)


def median_interval(values: Floats, alpha: float) -> Interval:
    """Return the exact interval of a median with confidence 1 - alpha: order statistics (scipy's `quantile_test`)."""
    low, high = _median_ranks(len(values), alpha)
    ordered = np.sort(values)
    return (-math.inf if low is None else float(ordered[low])), (math.inf if high is None else float(ordered[high]))


@lru_cache(maxsize=1000)
def _median_ranks(n: int, alpha: float) -> tuple[int | None, int | None]:
    """Return the places in a sorted sample of the ends of its median's interval; they depend on its size alone."""
    from scipy import stats

    tail = (1 - (1 - alpha)) / 2  # rounded as SciPy does
    low, high = int(stats.binom.ppf(tail, n, 0.5)) - 1, int(stats.binom.isf(tail, n, 0.5))
    return low if low >= 0 else None, high if high < n else None


def with_error(median: float, interval: Interval, error: float, alpha: float) -> Interval:
    """Widen a median's interval by the standard error of the published number that it is compared with.

    The squares of both errors are added at each end (Zou and Donner 2008, doi 10.1002/sim.3095).
    """
    from scipy import stats

    other = error * float(stats.norm.isf(alpha / 2))
    low, high = interval
    return median - math.hypot(median - low, other), median + math.hypot(high - median, other)


def smallest_alpha(decides: Callable[[float], bool]) -> float:
    """Return the p-value of a decision by intervals: the smallest alpha that decides, to seven digits; 1 if none."""
    low, high = 0.0, 1.0 - 1e-9
    if not decides(high):
        return 1.0
    while high - low > 1e-12 + 1e-7 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if decides(middle) else (middle, high)
    return high


def scale_of(*samples: Values) -> Scale:
    """Return the scale on which samples can be compared: ratios if no known value is 0 or negative."""
    arrays = [_array(sample) for sample in samples]
    return RATIO if all(np.all(array[~np.isnan(array)] > 0) for array in arrays) else DIFFERENCE


def contrast(a: Values, b: Values, scale: Scale | None = None, *, by_mean: bool = False) -> Contrast:
    """Compare paired samples.

    Args:
        a: One value per replicate; a pair in which either value is None or NaN is left out.
        b: The values to compare with, in the same order.
        scale: By default that of `scale_of`.
        by_mean: Estimate the mean difference, not the shift by Hodges and Lehmann.

    Raises:
        ValueError: If the samples differ in length, a value is infinite, or a ratio of values that have none is asked.
    """
    first, second = _array(a), _array(b)
    if len(first) != len(second):
        raise ValueError(f"paired samples must have the same length (got {len(first)} and {len(second)})")
    known = ~(np.isnan(first) | np.isnan(second))
    missing = int(np.sum(~known))
    first, second = first[known], second[known]
    scale = scale or scale_of(first, second)
    if scale == RATIO and scale_of(first, second) != RATIO:
        raise ValueError("values must be above 0 to have a ratio")
    if not len(first):
        return Contrast(scale, 0, missing, None, None, np.zeros(0))
    differences = np.log(first) - np.log(second) if scale == RATIO else first - second
    differences[np.abs(first - second) <= TIE * np.maximum(np.abs(first), np.abs(second))] = 0.0
    walsh = _walsh(differences)
    shift = float(np.median(walsh))
    rank_sum = float(np.sum(walsh > 0) + np.sum(walsh == 0) / 2)  # the signed-rank statistic
    effect = 2 * rank_sum / len(walsh) - 1
    if by_mean:
        shift, n = float(np.mean(differences)), len(differences)
        error = float(np.std(differences, ddof=1)) / math.sqrt(n) if n > 1 else math.nan
        return MeanContrast(scale, n, missing, math.exp(shift) if scale == RATIO else shift, effect, walsh, error)
    return Contrast(scale, len(first), missing, math.exp(shift) if scale == RATIO else shift, effect, walsh)


def p_of_margin(a: Values, b: Values, margin: float, *, by_mean: bool = False) -> tuple[float, float]:
    """Return the two-sided p-values of "a and b are within a margin above 1" and of "they are beyond it".

    Where some values are 0 there is no ratio; that a is at most `margin` times b is then tested by differences. Both
    are 1 if a value is negative.
    """
    if scale_of(a, b) == RATIO:
        tested = contrast(a, b, RATIO, by_mean=by_mean)
        return tested.p_within(margin), tested.p_beyond(margin)
    first, second = _array(a), _array(b)
    if min(np.nanmin(first, initial=0.0), np.nanmin(second, initial=0.0)) < 0:
        return 1.0, 1.0
    more, less = (
        contrast(one, margin * other, DIFFERENCE, by_mean=by_mean) for one, other in ((first, second), (second, first))
    )
    within = 2 * max(more.p_below(), less.p_below())
    return min(1.0, within), min(1.0, 2 * min(more.p_above(), less.p_above()))


def holm(p_values: Sequence[float]) -> list[tuple[float, float]]:
    """Return, for each p-value, Holm's adjusted p-value and the alpha at which Holm's procedure tests it.

    A comparison is rejected if its p-value is at most its alpha, which is exactly where the adjusted p-value is at most
    `ALPHA`. After the first comparison that is not rejected, alpha stays as it is.
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    steps = np.arange(len(p), 0, -1)
    failed = np.nonzero(p[order] * steps > ALPHA)[0]
    steps_tested = np.maximum(steps, steps[failed[0]]) if len(failed) else steps
    adjusted, alphas = np.empty_like(p), np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * steps), 1.0)
    alphas[order] = ALPHA / steps_tested
    return list(zip(adjusted.tolist(), alphas.tolist(), strict=True))


def smallest_p(pairs: int) -> float:
    """Return the smallest two-sided p-value that this many pairs can give: all differences have the same sign."""
    return min(1.0, 2.0 ** (1 - pairs))


def pairs_needed(family: int) -> int:
    """Return the minimum number of pairs for a test to become significant in a family of `family` tests (Holm)."""
    return next(pairs for pairs in range(1, 200) if smallest_p(pairs) * family <= ALPHA)


def smallest_effect(spread: float, pairs: int, family: int, power: float = 0.8) -> float:
    """Return the smallest shift that pairs would show with a probability of `power`; infinite if none can be shown.

    Args:
        spread: standard deviation of the paired differences, on the scale of the shift.
        pairs: number of pairs.
        family: number of tests that are corrected together; the shift must pass the first of Holm's tests.
        power: the probability.
    """
    from scipy import stats

    if pairs < pairs_needed(family):
        return math.inf
    quantiles = stats.t.isf(ALPHA / family / 2, pairs - 1) + stats.norm.ppf(power)
    return float(quantiles * spread / math.sqrt(SIGNED_RANK_EFFICIENCY * pairs))


def rejected_walsh(pairs: int, alpha: float) -> int:
    """Return how many Walsh averages at each end lie outside the interval of the two-sided test at `alpha`.

    The test rejects "no difference" where more than all others are above 0, or more than all others are below 0.
    """
    return int(np.searchsorted(_tails(pairs), alpha / 2, side="right"))


def _array(values: Values) -> Floats:
    array = np.array([math.nan if value is None else float(value) for value in values], dtype=float)
    if np.isinf(array).any():
        raise ValueError("values must be finite (got an infinite one)")
    return array


def _walsh(differences: Floats) -> Floats:
    """Return the sorted means of all pairs of differences, including each with itself."""
    i, j = np.triu_indices(len(differences))
    return np.sort((differences[i] + differences[j]) / 2)


def _tail(statistic: int, pairs: int) -> float:
    """Return the probability under the null hypothesis of a signed-rank statistic at least this large."""
    total = pairs * (pairs + 1) // 2
    return float(_tails(pairs)[total - statistic]) if pairs else 1.0


@lru_cache(maxsize=64)
def _tails(pairs: int) -> Floats:
    """Return the probabilities of a signed-rank statistic of at least n (n + 1) / 2 - k, for k = 0, 1, ..."""
    from scipy import stats

    total = pairs * (pairs + 1) // 2
    if pairs > MAX_EXACT:
        spread = math.sqrt(pairs * (pairs + 1) * (2 * pairs + 1) / 24)
        return np.asarray(stats.norm.sf((np.arange(total, -1, -1) - 0.5 - total / 2) / spread))
    probabilities = np.ones(1)
    for rank in range(1, pairs + 1):
        longer = np.zeros(len(probabilities) + rank)
        longer[: len(probabilities)] += probabilities / 2
        longer[rank:] += probabilities / 2
        probabilities = longer
    return np.cumsum(probabilities)
