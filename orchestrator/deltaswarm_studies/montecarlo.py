"""Monte Carlo standard errors: by how much an estimate would vary if all replicates were drawn anew."""

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


def of_median(values: pd.Series) -> float | None:
    """Return the standard error of a median; None with fewer than two values."""
    return _bootstrapped(values.to_numpy(float), lambda drawn: np.median(drawn, axis=-1))


def of_shift(a: pd.Series, b: pd.Series, scale: Scale) -> float | None:
    """Return the standard error of the estimate of `stats.contrast(a, b, scale)`, if whole pairs are drawn anew."""
    first, second = a.to_numpy(float), b.to_numpy(float)
    if scale == RATIO:
        return _bootstrapped(np.log(first) - np.log(second), lambda drawn: np.exp(_shift(drawn)))
    return _bootstrapped(first - second, _shift)


def of_resampled(estimates: Floats) -> float:
    """Return the standard error of an estimate by its bootstrap estimates; NaN if one of these is infinite."""
    return float(np.std(estimates, ddof=1)) if np.isfinite(estimates).all() else math.nan


def _bootstrapped(values: Floats, estimate: Callable[[Floats], Any]) -> float | None:
    """Return the standard error of an estimate of the values that are known; samples lie along the last axis."""
    known = values[~np.isnan(values)]
    if len(known) < 2:
        return None
    return float(np.std(estimate(known[_drawn(len(known))]), ddof=1))


@lru_cache(maxsize=100)
def _drawn(n: int) -> Indices:
    """Return the places of the values of each bootstrap sample, as `scipy.stats.bootstrap` draws them."""
    return np.random.RandomState(0).randint(0, n, (RESAMPLES, n))


def _shift(differences: Floats) -> Floats:
    """Return the shift by Hodges and Lehmann: the median of the means of all pairs."""
    i, j = np.triu_indices(differences.shape[-1])
    return np.asarray(np.median((differences[..., i] + differences[..., j]) / 2, axis=-1))
