"""Monte Carlo standard errors: how much an estimate would vary with new replicates."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd

from deltaswarm_studies.stats import RATIO, Floats, Scale

Indices: TypeAlias = npt.NDArray[np.int_]

RESAMPLES = 999
"""Bootstrap samples of the replicates, with seed 0."""

FEW = 200_000
"""Halving stops at this many pairs of all samples together; they are then counted one by one."""


def of_median(values: pd.Series) -> float | None:
    """Return the standard error of a median; None with fewer than two values."""
    return _bootstrapped(values.to_numpy(float), lambda known, drawn: np.median(known[drawn], axis=-1))


def of_shift(a: pd.Series, b: pd.Series, scale: Scale, *, by_mean: bool = False) -> float | None:
    """Return the standard error of the estimate of `stats.contrast`, if whole pairs are drawn anew."""
    first, second = a.to_numpy(float), b.to_numpy(float)
    shifts = _means if by_mean else _shifts
    if scale == RATIO:
        return _bootstrapped(np.log(first) - np.log(second), lambda known, drawn: np.exp(shifts(known, drawn)))
    return _bootstrapped(first - second, shifts)


def of_resampled(estimates: Floats) -> float:
    """Return the standard error of an estimate by its bootstrap estimates; NaN if one of these is infinite."""
    return float(np.std(estimates, ddof=1)) if np.isfinite(estimates).all() else math.nan


def _bootstrapped(values: Floats, estimate: Callable[[Floats, Indices], Any]) -> float | None:
    """Return the standard error of an estimate, made from the known values and each sample's places in them."""
    known = values[~np.isnan(values)]
    if len(known) < 2:
        return None
    return float(np.std(estimate(known, _drawn(len(known))), ddof=1))


@lru_cache(maxsize=100)
def _drawn(n: int) -> Indices:
    """Return the places of the values of each bootstrap sample, as `scipy.stats.bootstrap` draws them."""
    return np.random.RandomState(0).randint(0, n, (RESAMPLES, n))


def _means(values: Floats, drawn: Indices) -> Floats:
    return np.asarray(values[drawn].mean(axis=1))


def _shifts(values: Floats, drawn: Indices) -> Floats:
    """Return the shift by Hodges and Lehmann of each sample: the median of the means of all its pairs.

    A sample's pairs are pairs of the values, each some number of times. So the means are sorted once for all samples,
    and the middle one of each sample is found by halving: a row of counts tells in n steps how many of its pairs lie
    in the lower half, where the pairs themselves would take n^2.

    Args:
        values: (n,) the known values.
        drawn: (samples, n) places in `values`.
    """
    samples, n = drawn.shape
    order = np.argsort(values, kind="stable")
    place = np.argsort(order)[drawn] + n * np.arange(samples)[:, None]
    counts = np.bincount(place.ravel(), minlength=samples * n).reshape(samples, n)
    first, second = np.triu_indices(n)
    means = (values[order][first] + values[order][second]) / 2
    by_mean = np.argsort(means, kind="stable")
    means, first, second = means[by_mean], first[by_mean], second[by_mean]
    middle = {(len(means) - 1) // 2, len(means) // 2}
    found = [means[_places(rank, counts, first, second)] for rank in sorted(middle)]
    return np.asarray((found[0] + found[-1]) / 2)


def _places(rank: int, counts: Indices, first: Indices, second: Indices) -> Indices:
    """Return where the pair with this rank lies among the sorted pairs, for each sample.

    Args:
        rank: from 0, among a sample's own pairs, which include each drawn value with itself.
        counts: (samples, n) how often a sample has each of the sorted values.
        first: (pairs,) the place of each pair's smaller value, in the order of the means. A value's pairs with itself
            and with larger values lie there in the order of the larger ones, so some first ones are in the lower half.
        second: (pairs,) the place of the larger value.
    """
    samples, n = counts.shape
    upto = np.zeros((samples, n + 1), int)
    np.cumsum(counts, axis=1, out=upto[:, 1:])
    # What a product of counts has too many: pairs with smaller values, and pairs of equal ones in both orders.
    excess = np.zeros((samples, n + 1), int)
    np.cumsum(counts * upto[:, :-1] + counts * (counts - 1) // 2, axis=1, out=excess[:, 1:])
    places = np.empty(samples, int)
    todo = [(np.arange(samples), 0, len(first), np.zeros(samples, int))]
    while todo:
        rows, low, high, below = todo.pop()
        if high - low == 1 or len(rows) * (high - low) <= FEW:
            i, j, drawn = first[low:high], second[low:high], counts[rows]
            pairs = np.where(i == j, drawn[:, i] * (drawn[:, i] + 1) // 2, drawn[:, i] * drawn[:, j])
            places[rows] = low + np.sum(np.cumsum(pairs, axis=1) <= (rank - below)[:, None], axis=1)
            continue
        middle = (low + high) // 2
        partners = np.trim_zeros(np.bincount(first[:middle], minlength=n), "b")
        m = len(partners)
        lower = np.sum(counts[rows, :m] * upto[rows[:, None], np.arange(m) + partners], axis=1) - excess[rows, m]
        is_lower = lower > rank
        todo.append((rows[is_lower], low, middle, below[is_lower]))
        todo.append((rows[~is_lower], middle, high, lower[~is_lower]))
    return places
