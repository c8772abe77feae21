"""The estimates that a comparison gives, and their bootstrap intervals, drawn with a fixed seed."""

import math
import warnings
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
Interval = tuple[float | None, float | None]

RESAMPLES = 4999
TINY = 5
"""Below so many values BCa's jackknife has nothing to go by, and the plain percentile interval is given."""
NUMBERS_PER_BATCH = 2_000_000
"""What a batch of resamples may hold at once: 16 MB."""


def is_constant(array: Array) -> bool:
    """Whether all values are equal; there must be one."""
    return bool(np.all(array == array[0]))


def shift(a: Array, b: Array, paired: bool) -> float | None:
    """Hodges-Lehmann estimate of a - b."""
    if not len(a) or not len(b):
        return None
    return float(_walsh_median(a - b) if paired else _pairwise_median(a, b))


def _walsh_median(differences: Array, axis: int = -1) -> Array:
    """The median of the means of all pairs of differences, each with itself among them."""
    last = np.moveaxis(differences, axis, -1)
    i, j = np.triu_indices(last.shape[-1])
    return np.asarray(np.median((last[..., i] + last[..., j]) / 2, axis=-1))


def _pairwise_median(a: Array, b: Array, axis: int = -1) -> Array:
    """The median of all differences between a value of `a` and one of `b`."""
    first, second = np.moveaxis(a, axis, -1), np.moveaxis(b, axis, -1)
    differences = first[..., :, None] - second[..., None, :]
    return np.asarray(np.median(differences.reshape(*differences.shape[:-2], -1), axis=-1))


def shift_interval(a: Array, b: Array, paired: bool, confidence: float, seed: int) -> Interval:
    """The interval of `shift`; that of b - a is its mirror image."""
    if paired:
        n = len(a)
        return bootstrap_interval((a - b,), _walsh_median, confidence=confidence, seed=seed, cost=n * (n + 1) // 2)
    # The generator serves the first sample first: one order, whichever way round they are compared.
    swap = sorted(a) > sorted(b)
    samples = (b, a) if swap else (a, b)
    low, high = bootstrap_interval(samples, _pairwise_median, confidence=confidence, seed=seed, cost=len(a) * len(b))
    return (_negative(high), _negative(low)) if swap else (low, high)


def _negative(value: float | None) -> float | None:
    return None if value is None else -value


def ratio_of_medians(a: Array, b: Array, paired: bool, confidence: float, seed: int) -> tuple[float | None, Interval]:
    """The ratio of the medians; through its logarithm, so that b/a has the reciprocal interval."""
    if not len(a) or not len(b) or min(a.min(), b.min()) <= 0:
        return None, (None, None)
    swap = sorted(a) > sorted(b)
    samples = (b, a) if swap else (a, b)
    low, high = bootstrap_interval(
        samples, _log_ratio, confidence=confidence, seed=seed, cost=max(len(a), len(b)), together=paired
    )
    ratio = float(np.median(a) / np.median(b))
    if low is None or high is None:
        return ratio, (None, None)
    low, high = (math.exp(-high), math.exp(-low)) if swap else (math.exp(low), math.exp(high))
    return ratio, (min(low, ratio), max(high, ratio))


def _log_ratio(a: Array, b: Array, axis: int = -1) -> Array:
    return np.asarray(np.log(np.median(a, axis=axis)) - np.log(np.median(b, axis=axis)))


def bootstrap_interval(
    samples: tuple[Array, ...],
    statistic: Callable[..., Any],
    *,
    confidence: float,
    seed: int,
    cost: int,
    together: bool = False,
) -> Interval:
    """A statistic's interval: BCa, or the percentile interval for tiny samples and where BCa has no answer.

    `cost` is how many numbers one resample needs; `together` resamples pairs.
    """
    if not 0 < confidence < 1:
        raise ValueError(f"the confidence is {confidence}; it must be between 0 and 1")
    if min(len(sample) for sample in samples) < 2:
        return None, None
    estimate = float(statistic(*samples, axis=-1))
    if all(is_constant(sample) for sample in samples):
        return estimate, estimate
    methods: list[Literal["BCa", "percentile"]] = ["BCa", "percentile"]
    for method in methods if min(len(sample) for sample in samples) >= TINY else methods[1:]:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that BCa has no answer shows in its interval, below
            found = stats.bootstrap(
                samples,
                statistic,
                n_resamples=RESAMPLES,
                batch=max(1, NUMBERS_PER_BATCH // max(cost, 1)),
                vectorized=True,
                paired=together,
                axis=-1,
                confidence_level=confidence,
                method=method,
                rng=np.random.default_rng(seed),
            )
        low, high = (float(end) for end in found.confidence_interval)
        if low <= estimate <= high:
            break
    # Equal values, averaged in another order, may differ in the last digit.
    return min(low, estimate), max(high, estimate)
