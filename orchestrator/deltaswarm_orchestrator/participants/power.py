"""How many participants show a difference between two conditions: power by resampling a pilot's participants. Pure.

A participant's difference between the conditions is the unit. A study of n participants is n differences drawn from
the pilot's with replacement, moved so that their mean is the effect in question; power is the share of such studies
whose test rejects "no difference".
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from deltaswarm_orchestrator.stats import rejected_walsh

Array = NDArray[np.float64]

T_TEST, SIGNED_RANK = "t", "signed-rank"
TESTS = {T_TEST: "paired t-test", SIGNED_RANK: "Wilcoxon's signed-rank test"}
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


class Spread(NamedTuple):
    """A pilot's differences: their mean with its 95 % interval (of normal differences), and standard deviation."""

    mean: float
    low: float
    high: float
    deviation: float


def spread_of(differences: Array) -> Spread:
    """Describe at least two differences."""
    mean, deviation = float(np.mean(differences)), float(np.std(differences, ddof=1))
    half = float(stats.t.isf(0.025, len(differences) - 1)) * deviation / math.sqrt(len(differences))
    return Spread(mean, mean - half, mean + half, deviation)


def powers(
    differences: Array, effect: float, *, group: int, wanted: float, alpha: float, test: str, seed: int
) -> list[Power]:
    """Search for the least number of groups of participants that has the wanted power; return all that were tried.

    The numbers double up to the first that has it, or to `MAX_PARTICIPANTS`, and then close in on the least.

    Args:
        differences: One per participant of the pilot, at least two; they must not all be equal.
        effect: The mean difference to find, in the same unit.
        group: Participants who do every order equally often.
        wanted: Power that is enough.
        alpha: Level of the two-sided test.
        test: One of `TESTS`.
        seed: The same seed gives the same numbers.
    """
    tried: dict[int, Power] = {}

    def is_enough(groups: int) -> bool:
        n = groups * group
        power = _power(differences, effect, n, alpha, test, np.random.default_rng((seed, n)))
        tried[n] = Power(n, power, math.sqrt(power * (1 - power) / RESAMPLES))
        return power >= wanted

    low, high, most = 0, 1, MAX_PARTICIPANTS // group
    while not (found := is_enough(high)) and high < most:
        low, high = high, min(2 * high, most)
    while found and high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return [tried[n] for n in sorted(tried)]


def _power(
    differences: Array, effect: float, participants: int, alpha: float, test: str, rng: np.random.Generator
) -> float:
    pilot = len(differences)
    # Drawn from the pilot, differences vary by the factor (pilot - 1) / pilot less than in the population.
    residuals = (differences - np.mean(differences)) * math.sqrt(pilot / (pilot - 1))
    times_drawn = rng.multinomial(participants, np.full(pilot, 1 / pilot), size=RESAMPLES).astype(float)
    rejects = _t_rejects if test == T_TEST else _signed_rank_rejects
    return float(np.mean(rejects(times_drawn, residuals, effect, alpha)))


def _t_rejects(times_drawn: Array, residuals: Array, effect: float, alpha: float) -> NDArray[np.bool_]:
    """Test each row. Equal differences, which only a coarse scale or a small pilot gives, do not count as an effect."""
    n = float(times_drawn[0].sum())
    mean = times_drawn @ residuals / n
    variance = (times_drawn @ residuals**2 - n * mean**2) / (n - 1)
    varies = variance > ROUNDING * np.mean(residuals**2)
    return varies & ((effect + mean) ** 2 > stats.t.isf(alpha / 2, n - 1) ** 2 * variance / n)


def _signed_rank_rejects(times_drawn: Array, residuals: Array, effect: float, alpha: float) -> NDArray[np.bool_]:
    """Test each row by the Walsh averages of its differences, as `stats.contrast` does."""
    n = int(times_drawn[0].sum())
    others = n * (n + 1) // 2 - rejected_walsh(n, alpha)
    sums = effect + residuals[:, None] + (effect + residuals)[None, :]

    def count(signs: NDArray[np.bool_]) -> Array:
        pairs = np.einsum("ri,ri->r", times_drawn @ signs, times_drawn)  # counts each pair of two twice
        return np.asarray((pairs + times_drawn @ np.diag(signs)) / 2)

    return (count(sums > 0) > others) | (count(sums < 0) > others)
