"""Compare a sample with a published number whose spread and replicates are known, as two samples (Welch's test)."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from deltaswarm_studies.stats import MEDIAN_ERROR, NOWHERE, Floats, Interval

MAX_REPLICATES = 10_000
"""Where more would be needed for a decision, none is expected."""

POWER = 0.8
"""The probability with which the number of replicates that is asked for decides."""


@dataclass(frozen=True)
class Spread:
    """A number with its standard error and the size of the sample that it comes from."""

    value: float
    error: Any
    n: Any
    """A number, or an array of sizes with the error of each."""

    @classmethod
    def of(cls, values: Floats, *, is_median: bool) -> "Spread":
        """Return a sample's mean, or its median with the error that its interquartile range has in a normal sample."""
        n = len(values)
        if not is_median:
            return cls(float(np.mean(values)), float(np.std(values, ddof=1)) / math.sqrt(n) if n > 1 else math.nan, n)
        q1, median, q3 = (float(value) for value in np.quantile(values, (0.25, 0.5, 0.75)))
        return cls(median, MEDIAN_ERROR * (q3 - q1) / math.sqrt(n) if n > 1 else math.nan, n)

    def sized(self, n: Any) -> "Spread":
        """Return what samples of other sizes would show if they had the same value and spread."""
        return Spread(self.value, self.error * np.sqrt(self.n / n), n)


@dataclass(frozen=True)
class Welch:
    """Two samples of which only number, standard error and size are known."""

    ours: Spread
    theirs: Spread

    @property
    def difference(self) -> float:
        """Ours less theirs."""
        return self.ours.value - self.theirs.value

    def interval(self, alpha: float) -> Interval:
        if math.isnan(self.error):
            return NOWHERE
        half = float(stats.t.isf(alpha / 2, self.freedom) * self.error)
        return self.difference - half, self.difference + half

    def p(self) -> float:
        """Return the two-sided p-value against "they do not differ"."""
        return min(1.0, 2 * min(self._above(0.0), self._above(0.0, -1)))

    def p_within(self, low: float, high: float) -> float:
        """Return the two-sided p-value of "the difference lies from `low` to `high`": two one-sided tests.

        It is at most alpha exactly where the interval at alpha lies within.
        """
        return min(1.0, 2 * max(self._above(low), self._above(high, -1)))

    def replicates(self, low: float, high: float, alpha: float, *, of_both: bool = False) -> int | None:
        """Return how many replicates of ours would decide at alpha with a probability of `POWER`; None: no number.

        If what was found is the truth, so many show a difference, or that it lies from `low` to `high`, whichever takes
        fewer. The published number stays as uncertain as it is, unless the source is to have as many replicates as we.
        """
        n = np.arange(2, MAX_REPLICATES + 1)
        sized = Welch(self.ours.sized(n), self.theirs.sized(n) if of_both else self.theirs)
        inside = min(self.difference - low, high - self.difference)
        decides = np.zeros(len(n), bool)
        for distance, power in ((abs(self.difference), POWER), (inside, (1 + POWER) / 2)):
            quantiles = stats.t.isf(alpha / 2, sized.freedom) + stats.t.ppf(power, sized.freedom)
            decides |= distance > quantiles * sized.error
        return int(n[decides.argmax()]) if decides.any() else None

    @property
    def error(self) -> Any:
        """Return the standard error of the difference; NaN if one side has a single replicate."""
        return np.hypot(self.ours.error, self.theirs.error)

    @property
    def freedom(self) -> Any:
        """Return Welch's and Satterthwaite's degrees of freedom."""
        ours, theirs = self.ours.error**2, self.theirs.error**2
        return (ours + theirs) ** 2 / (ours**2 / (self.ours.n - 1) + theirs**2 / (self.theirs.n - 1))

    def _above(self, null: float, sign: int = 1) -> float:
        """Return the one-sided p-value against "it is at most `null`"; with sign -1 "it is at least `null`"."""
        if math.isnan(self.error):
            return 1.0
        return float(stats.t.sf(sign * (self.difference - null) / self.error, self.freedom))
