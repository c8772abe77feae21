"""The statistics against scipy and against their definitions."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats as scipy_stats

from deltaswarm_studies.stats import (
    ALPHA,
    contrast,
    describe,
    holm,
    median_interval,
    p_of_margin,
    scale_of,
    smallest_alpha,
    smallest_effect,
    with_error,
)
from tests.support.tiers import in_one_test

SIZES = st.lists(st.integers(1, 100), min_size=1, max_size=25, unique=True)
GRID = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=20)
"""Pairs with many ties and many that do not differ."""
ALPHAS = st.sampled_from([0.05, 0.05 / 3, 0.05 / 15, 0.3])


@given(SIZES, st.integers(0, 2**25))
def test_without_ties_p_is_scipys(sizes: list[int], signs: int) -> None:
    array = np.array([size if signs >> index & 1 else -size for index, size in enumerate(sizes)])
    found = contrast(array - 200, np.zeros(len(array)) - 200)
    assert found.p() == pytest.approx(min(1.0, scipy_stats.wilcoxon(array, method="exact").pvalue))


@given(GRID, ALPHAS, st.sampled_from([0.5, 1.0, 1.25]))
def test_interval_and_p_never_contradict_each_other(pairs: list[tuple[int, int]], alpha: float, null: float) -> None:
    """The interval excludes a value exactly where its p is at most alpha, ties or not; of differences and of ratios."""
    for shift in (-10, 1):
        a, b = (np.array(side, dtype=float) + shift for side in zip(*pairs, strict=True))
        found = contrast(a, b)
        low, high = found.interval(alpha)
        tie = 1e-8 if found.scale == "ratio" else 0.0
        assert (low > null + tie or high < null - tie) <= (found.p(null) <= alpha) <= (low > null or high < null)
        assert found.estimate is not None
        assert low <= found.estimate <= high


@given(GRID, st.floats(1.01, 4), ALPHAS)
def test_an_interval_and_a_margin_never_contradict_each_other(
    pairs: list[tuple[int, int]], margin: float, alpha: float
) -> None:
    """It lies within the margin, or beyond it, exactly where that p is at most alpha; but for rounding at a tie."""
    a, b = (np.array(side, dtype=float) + 1 for side in zip(*pairs, strict=True))
    found = contrast(a, b)
    low, high = found.interval(alpha)
    tie = 1 + 2e-9
    assert (1 / margin * tie < low and high * tie < margin) <= (found.p_within(margin) <= alpha)
    assert (found.p_within(margin) <= alpha) <= (1 / margin < low * tie and high < margin * tie)
    assert (high * tie < 1 / margin or low > margin * tie) <= (found.p_beyond(margin) <= alpha)
    assert (found.p_beyond(margin) <= alpha) <= (high < 1 / margin * tie or low * tie > margin)


@given(GRID, st.floats(1.5, 4))
def test_a_contrast_turned_round_says_the_same(pairs: list[tuple[int, int]], margin: float) -> None:
    a, b = (np.array(side, dtype=float) + 1 for side in zip(*pairs, strict=True))
    one, other = contrast(a, b), contrast(b, a)
    assert one.p() == pytest.approx(other.p())
    assert one.p_within(margin) == pytest.approx(other.p_within(margin))
    assert one.p_beyond(margin) == pytest.approx(other.p_beyond(margin))
    assert one.p(margin) == pytest.approx(other.p(1 / margin))
    assert one.estimate == pytest.approx(1 / other.estimate)  # type: ignore[operator]
    assert one.effect == pytest.approx(-other.effect)  # type: ignore[operator]


def test_the_interval_covers_the_shift_as_often_as_it_says() -> None:
    """In at least 95 of 100 samples, within what 1,000 samples can tell; seed 7."""
    generator = np.random.default_rng(7)
    inside = 0
    for _ in range(1000):
        low, high = contrast(generator.normal(0.5, 1, 12) - 50, np.zeros(12) - 50).interval(ALPHA)
        inside += low <= 0.5 <= high
    assert inside >= 1000 * 0.95 - 3 * math.sqrt(1000 * 0.95 * 0.05)


def test_ratios_where_all_is_positive_else_differences() -> None:
    """A metric that is 0 in some run has no ratio; missing values do not matter."""
    assert scale_of([2, 4, None], [1, 2, 3]) == "ratio"
    assert contrast([2, 4, 6], [1, 2, 3]).estimate == pytest.approx(2)
    assert scale_of([2, 4, 0], [1, 2, 3]) == scale_of([1], [-1.0]) == "difference"
    assert contrast([2, 4, 0], [1, 1, 1]).estimate == pytest.approx(1)
    assert contrast([2, 4, 6], [1, 2, 3], "difference").estimate == pytest.approx(2)


def test_ratios_that_differ_only_by_rounding_are_ties() -> None:
    """Values that are all 1.1 times as large are no evidence for more, or for less, than 1.1 times."""
    values = np.arange(1, 41) / 7
    found = contrast(values * 1.1, values)
    assert found.p_above(1.1) == found.p_below(1.1) == 1.0
    assert found.p(1.1) == found.p_within(1.1) == found.p_beyond(1.1) == 1.0
    assert found.p(1.09) < 1e-9
    assert found.p(1.11) < 1e-9


@pytest.mark.parametrize("scale", ["ratio", "difference"])
def test_rounding_is_no_difference_on_any_scale(scale: Any) -> None:
    """Twenty sums that differ in the last digit, all in one direction, hold nothing."""
    values = [0.1 * number + 0.3 for number in range(1, 21)]
    found = contrast([value * (1 + 4e-16) for value in values], values, scale)
    assert (found.p(), found.effect, found.estimate) == (1.0, 0.0, found.none)
    assert contrast([value * (1 + 1e-6) for value in values], values, scale).p() < 0.001


def test_one_zero_does_not_silence_a_margin() -> None:
    """Where there is no ratio, a is still at most 1.2 times b and b at most 1.2 times a; or one of them is not."""
    b = [0.0, *(float(value) for value in range(10, 20))]
    alike, apart = [value * 1.05 for value in b], [value * 1.5 for value in b]
    for first, second in ((alike, b), (b, alike)):
        within, beyond = p_of_margin(first, second, 1.2)
        assert within < 0.01 < 0.9 < beyond
    for first, second in ((apart, b), (b, apart)):
        within, beyond = p_of_margin(first, second, 1.2)
        assert beyond < 0.01 < 0.9 < within
    assert p_of_margin([-1.0] * 9, [-1.0] * 9, 1.2) == (1.0, 1.0)
    ratios = p_of_margin(alike[1:], b[1:], 1.2)  # with ratios, by ratios
    tested = contrast(alike[1:], b[1:])
    assert ratios == (tested.p_within(1.2), tested.p_beyond(1.2))


def test_quartiles_are_those_of_the_known_values() -> None:
    found = describe([*range(41), None, math.nan])
    assert (found.n, found.missing, found.q1, found.median, found.q3) == (41, 2, 10.0, 20.0, 30.0)


def test_pairs_with_a_missing_value_are_left_out_and_counted() -> None:
    """And nothing at all gives no estimate, no evidence and no interval."""
    found = contrast([1, None, 3, math.nan], [1, 2, None, 4])
    assert (found.n, found.missing) == (1, 3)
    nothing = contrast([], [])
    assert (nothing.n, nothing.p(), nothing.estimate) == (0, 1.0, None)
    assert nothing.interval(ALPHA) == (-math.inf, math.inf)


@in_one_test(
    ("a", "b", "scale"), [([1], [1, 2], None), ([math.inf], [1], None), ([0], [1], "ratio"), ([1], [-1], "ratio")]
)
def test_impossible_samples_are_refused(a: list[float], b: list[float], scale: str | None) -> None:
    with pytest.raises(ValueError, match="must"):
        contrast(a, b, scale)  # type: ignore[arg-type]


def test_a_published_error_widens_an_interval() -> None:
    """By the root of the sum of squares at each end; it covers the published median as often as it says; seed 3."""
    assert with_error(10.0, (7.0, 13.0), 0.0, ALPHA) == (7.0, 13.0)
    low, high = with_error(10.0, (7.0, 14.0), 2.0, ALPHA)
    other = 2.0 * float(scipy_stats.norm.isf(0.025))
    assert (10 - low, high - 10) == (pytest.approx(math.hypot(3, other)), pytest.approx(math.hypot(4, other)))
    assert with_error(10.0, (-math.inf, math.inf), 1.0, ALPHA) == (-math.inf, math.inf)
    generator, covered = np.random.default_rng(3), 0
    for _ in range(500):
        ours, theirs = generator.normal(0, 1, 20), generator.normal(0, 1, 20)
        error = 1.2533 / 20**0.5
        low, high = with_error(float(np.median(ours)), median_interval(ours, ALPHA), error, ALPHA)
        covered += low <= float(np.median(theirs)) <= high
    assert covered >= 500 * 0.95 - 3 * math.sqrt(500 * 0.95 * 0.05)


@given(st.floats(1e-6, 0.999))
def test_the_smallest_alpha_that_decides_is_found(threshold: float) -> None:
    assert smallest_alpha(lambda alpha: alpha >= threshold) == pytest.approx(threshold, rel=1e-6)
    assert smallest_alpha(lambda alpha: False) == 1.0


P_VALUES = st.lists(st.floats(0, 1), min_size=1, max_size=6)


@given(P_VALUES)
def test_holm_is_the_closure_of_bonferronis_tests(p: list[float]) -> None:
    """A hypothesis is rejected if every intersection of hypotheses that holds it is."""
    expected = [
        max(
            min(1.0, len(chosen) * min(p[i] for i in chosen))
            for size in range(1, len(p) + 1)
            for chosen in itertools.combinations(range(len(p)), size)
            if index in chosen
        )
        for index in range(len(p))
    ]
    assert [adjusted for adjusted, _ in holm(p)] == pytest.approx(expected)


@given(P_VALUES)
def test_holms_alpha_rejects_what_its_p_rejects(p: list[float]) -> None:
    """So an interval at that alpha excludes "no difference" exactly where the corrected p is at most 0.05."""
    for value, (adjusted, alpha) in zip(p, holm(p), strict=True):
        if not math.isclose(adjusted, ALPHA, rel_tol=1e-9):
            assert (value <= alpha) == (adjusted <= ALPHA)
        assert ALPHA / len(p) <= alpha <= ALPHA


@pytest.mark.parametrize(("pairs", "family"), [(20, 1), (20, 8), (12, 3)])
def test_the_smallest_effect_is_shown_as_often_as_it_says(pairs: int, family: int) -> None:
    """With a probability of 80 %, within what 400 samples can tell; seed 11. Too few pairs show nothing."""
    generator, shown = np.random.default_rng(11), 0
    shift = smallest_effect(2.0, pairs, family)
    for _ in range(400):
        shown += contrast(generator.normal(shift, 2.0, pairs), np.zeros(pairs), "difference").p() <= ALPHA / family
    assert 0.72 < shown / 400 < 0.9
    assert smallest_effect(2.0, 6, 7) == math.inf


@pytest.mark.parametrize("n", [1, 5, 6, 20, 61])
@pytest.mark.parametrize("alpha", [0.05, 0.0123, 0.9])
def test_the_interval_of_a_median_is_that_of_scipys_quantile_test(n: int, alpha: float) -> None:
    """Also of values with ties; a missing end is infinite."""
    values = np.random.default_rng(n).normal(size=n).round(1)
    test = scipy_stats.quantile_test(values, q=float(np.median(values)), p=0.5).confidence_interval(1 - alpha)
    low, high = median_interval(values, alpha)
    assert (low, high) == (np.nan_to_num(test.low, nan=-math.inf), np.nan_to_num(test.high, nan=math.inf))
