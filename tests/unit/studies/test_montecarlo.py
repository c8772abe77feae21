"""Monte Carlo standard errors of small samples, whose bootstrap distributions can be written down."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import bootstrap

from deltaswarm_studies import montecarlo
from deltaswarm_studies.stats import DIFFERENCE, RATIO

NAN = float("nan")


def test_the_error_of_the_median_of_two_values_by_hand() -> None:
    """Drawn anew, 0 and 2 have the median 0, 1 or 2 with the probabilities 1/4, 1/2 and 1/4: variance 1/2."""
    assert montecarlo.of_median(pd.Series([0.0, 2.0, NAN])) == pytest.approx(math.sqrt(0.5), rel=0.05)


def test_the_error_of_the_median_of_three_values_by_hand() -> None:
    """Of 0, 0 and 3, two or three of three draws are the 3 in 7 of 27 cases: variance 9 * 7/27 * 20/27."""
    assert montecarlo.of_median(pd.Series([0.0, 0.0, 3.0])) == pytest.approx(math.sqrt(9 * 140 / 729), rel=0.05)


def test_the_error_of_a_shift_by_hand() -> None:
    """Of two pairs, the shift is the mean of both differences: 0, 1 or 2; as a ratio 1, e or e squared."""
    a, b = pd.Series([5.0, 9.0, NAN]), pd.Series([5.0, 7.0, 1.0])
    assert montecarlo.of_shift(a, b, DIFFERENCE) == pytest.approx(math.sqrt(0.5), rel=0.05)
    mean, square = (1 + 2 * math.e + math.e**2) / 4, (1 + 2 * math.e**2 + math.e**4) / 4
    ratio = montecarlo.of_shift(pd.Series([1.0, math.e**2]), pd.Series([1.0, 1.0]), RATIO)
    assert ratio == pytest.approx(math.sqrt(square - mean**2), rel=0.05)


def test_what_cannot_vary_has_no_error_and_one_value_has_none_that_is_known() -> None:
    """Equal values give 0; of a single replicate nobody knows by how much it would vary."""
    assert montecarlo.of_median(pd.Series([4.0] * 5)) == 0.0
    assert montecarlo.of_median(pd.Series([4.0, NAN])) is None
    assert montecarlo.of_shift(pd.Series([4.0]), pd.Series([2.0]), RATIO) is None


def test_the_error_of_bootstrap_estimates_by_hand() -> None:
    """Of 1, 2 and 3 it is 1; if one of them is infinite, there is none."""
    assert montecarlo.of_resampled(np.array([1.0, 2.0, 3.0])) == 1.0
    assert math.isnan(montecarlo.of_resampled(np.array([1.0, math.inf])))


@pytest.mark.parametrize("n", [2, 5, 20, 61, 150])
def test_the_errors_are_those_of_scipys_bootstrap(n: int) -> None:
    """To the last digit: published tables have them."""
    values = np.random.default_rng(n).lognormal(size=n).round(2)
    options = {"n_resamples": montecarlo.RESAMPLES, "method": "percentile", "vectorized": True, "random_state": 0}
    expected = bootstrap((values,), np.median, axis=-1, **options).standard_error
    assert montecarlo.of_median(pd.Series(values)) == expected

    def shift(drawn: np.ndarray, axis: int) -> np.ndarray:
        i, j = np.triu_indices(drawn.shape[axis])
        return np.median((drawn[..., i] + drawn[..., j]) / 2, axis=axis)

    expected = bootstrap((values - 1.0,), shift, axis=-1, **options).standard_error
    assert montecarlo.of_shift(pd.Series(values), pd.Series(np.ones(n)), DIFFERENCE) == expected
