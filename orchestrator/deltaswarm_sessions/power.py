"""How many participants show a difference between two conditions: power by resampling a pilot's participants. Pure.

A participant's difference between the conditions is the unit. A study of n participants is n differences drawn from
the pilot's with replacement, moved so that their mean is the effect in question; power is the share of such studies
whose test rejects "no difference". What position and stream do to a difference can be removed first, as a mixed model
with a random intercept per participant does.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import orth
from statsmodels.regression.linear_model import OLS

from deltaswarm_studies.stats import rejected_walsh

Array = NDArray[np.float64]

ADJUSTED, T_TEST, SIGNED_RANK = "adjusted", "t", "signed-rank"
TESTS = {
    ADJUSTED: "t-test of differences adjusted for position and stream",
    T_TEST: "paired t-test",
    SIGNED_RANK: "Wilcoxon's signed-rank test",
}
"""Two-sided tests of paired differences."""

RESAMPLES = 10_000
"""Studies drawn for each number of participants."""
MAX_PARTICIPANTS = 1000
"""The search for a number of participants ends here."""
ROUNDING = 1e-12
"""Variances that are smaller, relative to the pilot's, are 0 but for rounding."""


class Power(NamedTuple):
    """The power of a number of participants."""

    participants: int
    power: float
    error: float
    """Standard error of the power, from the number of resamples."""


class Pilot(NamedTuple):
    """A pilot's differences: their mean, and what is left of each."""

    mean: float
    error: float
    """Standard error of the mean."""
    interval: tuple[float, float]
    """The 95 % interval of the mean, for normal differences."""
    residuals: Array
    degrees: int
    """Degrees of freedom of the residuals: less than their number by the mean, and by what was fitted besides."""

    @property
    def parameters(self) -> int:
        """Number of parameters that were fitted: the mean, and those of position and stream."""
        return len(self.residuals) - self.degrees

    @property
    def deviation(self) -> float:
        return math.sqrt(float(np.sum(self.residuals**2)) / self.degrees)


def fit(differences: Array, others: Array | None = None) -> Pilot | None:
    """Fit the mean of differences, and what the columns of `others` (one row per difference) add to it.

    Returns None where the mean cannot be told apart from what the others add, or where no degree of freedom is left.
    """
    columns = np.ones((len(differences), 1))
    if others is not None:
        columns = np.hstack([columns, orth(others)])  # streams are redundant columns: each run has one of them
    model = OLS(differences, columns)
    if model.df_resid < 1 or model.df_resid > len(differences) - columns.shape[1]:
        return None
    found = model.fit()
    low, high = map(float, found.conf_int(0.05)[0])
    return Pilot(float(found.params[0]), float(found.bse[0]), (low, high), found.resid, int(model.df_resid))


def powers(
    pilot: Pilot, effect: float, *, group: int, wanted: float, alpha: float, test: str, seed: int
) -> list[Power]:
    """Search for the least number of groups of participants that has the wanted power; return all that were tried.

    The numbers double up to the first that has it, or to `MAX_PARTICIPANTS`, and then close in on the least.
    The pilot's differences must not all be equal. `group`: participants who do every order equally often.
    """
    tried: dict[int, Power] = {}

    def is_enough(groups: int) -> bool:
        n = groups * group
        power = _power(pilot, effect, n, alpha, test, np.random.default_rng((seed, n)))
        tried[n] = Power(n, power, math.sqrt(power * (1 - power) / RESAMPLES))
        return power >= wanted

    low, high, most = 0, 1, MAX_PARTICIPANTS // group
    while not (found := is_enough(high)) and high < most:
        low, high = high, min(2 * high, most)
    while found and high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return [tried[n] for n in sorted(tried)]


def _power(pilot: Pilot, effect: float, participants: int, alpha: float, test: str, rng: np.random.Generator) -> float:
    count = len(pilot.residuals)
    # Residuals of a pilot vary less than differences in the population: it has the pilot's degrees of freedom.
    residuals = pilot.residuals * math.sqrt(count / pilot.degrees)
    times_drawn = rng.multinomial(participants, np.full(count, 1 / count), size=RESAMPLES).astype(float)
    if test == SIGNED_RANK:
        return float(np.mean(signed_rank_rejects(times_drawn, residuals, effect, alpha)))
    if participants <= pilot.parameters:
        return 0.0
    return float(np.mean(t_rejects(times_drawn, residuals, effect, alpha, participants - pilot.parameters)))


def t_rejects(times_drawn: Array, residuals: Array, effect: float, alpha: float, degrees: int) -> NDArray[np.bool_]:
    """Test each row. Equal differences, which only a coarse scale or a small pilot gives, do not count as an effect."""
    n = float(times_drawn[0].sum())
    mean = times_drawn @ residuals / n
    # Resamples have nothing left to adjust for; a study loses these degrees of freedom, which only the limit tells.
    variance = (times_drawn @ residuals**2 - n * mean**2) / (n - 1)
    varies = variance > ROUNDING * np.mean(residuals**2)
    return varies & ((effect + mean) ** 2 > stats.t.isf(alpha / 2, degrees) ** 2 * variance / n)


def signed_rank_rejects(times_drawn: Array, residuals: Array, effect: float, alpha: float) -> NDArray[np.bool_]:
    """Test each row by the Walsh averages of its differences, as `stats.contrast` does."""
    n = int(times_drawn[0].sum())
    others = n * (n + 1) // 2 - rejected_walsh(n, alpha)
    sums = effect + residuals[:, None] + (effect + residuals)[None, :]

    def count(signs: NDArray[np.bool_]) -> Array:
        pairs = np.einsum("ri,ri->r", times_drawn @ signs, times_drawn)  # counts each pair of two twice
        return np.asarray((pairs + times_drawn @ np.diag(signs)) / 2)

    return (count(sums > 0) > others) | (count(sums < 0) > others)
