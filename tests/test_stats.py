"""The statistics against scipy and against their definitions."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats as scipy_stats

from deltaswarm_orchestrator.stats import contrast, describe, holm, pairs_needed, smallest_p

SIZES = st.lists(st.integers(1, 100), min_size=1, max_size=25, unique=True)
GRID = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=20)
"""Pairs with many ties and many that do not differ."""


@given(SIZES, st.integers(0, 2**25))
def test_without_ties_p_is_scipys(sizes: list[int], signs: int) -> None:
    """The exact signed-rank test of differences that all differ in size."""
    array = np.array([size if signs >> index & 1 else -size for index, size in enumerate(sizes)])
    found = contrast(array - 200, np.zeros(len(array)) - 200)
    assert found.p == pytest.approx(min(1.0, scipy_stats.wilcoxon(array, method="exact").pvalue))


@given(GRID)
def test_interval_and_p_never_contradict_each_other(pairs: list[tuple[int, int]]) -> None:
    """The interval excludes "no difference" exactly where p is at most 0.05, ties or not; also of ratios."""
    for shift, none in ((-10, 0.0), (1, 1.0)):
        a, b = (np.array(side, dtype=float) + shift for side in zip(*pairs, strict=True))
        found = contrast(a, b)
        if found.low is None or found.high is None:
            assert found.p > 0.05
        else:
            assert (found.low > none or found.high < none) == (found.p <= 0.05)
            assert found.estimate is not None
            assert found.low <= found.estimate <= found.high


@given(GRID, st.floats(1.5, 4))
def test_a_contrast_turned_round_says_the_same(pairs: list[tuple[int, int]], margin: float) -> None:
    """With the ratio inverted and the effect's sign changed."""
    a, b = (np.array(side, dtype=float) + 1 for side in zip(*pairs, strict=True))
    one, other = contrast(a, b, margin=margin), contrast(b, a, margin=margin)
    assert one.p == pytest.approx(other.p)
    assert one.p_alike == pytest.approx(other.p_alike)
    assert one.p_beyond == pytest.approx(other.p_beyond)
    assert one.estimate == pytest.approx(1 / other.estimate)  # type: ignore[operator]
    assert one.effect == pytest.approx(-other.effect)  # type: ignore[operator]


def test_the_interval_covers_the_shift_as_often_as_it_says() -> None:
    """In at least 95 of 100 samples, within what 1,000 samples can tell; seed 7."""
    generator = np.random.default_rng(7)
    inside = 0
    for _ in range(1000):
        found = contrast(generator.normal(0.5, 1, 12) - 50, np.zeros(12) - 50)
        assert found.low is not None
        assert found.high is not None
        inside += found.low <= 0.5 <= found.high
    assert inside >= 1000 * 0.95 - 3 * math.sqrt(1000 * 0.95 * 0.05)


def test_ratios_where_all_is_positive_else_differences() -> None:
    """A metric that is 0 in some run has no ratio."""
    assert contrast([2, 4, 6], [1, 2, 3]).scale == "ratio"
    assert contrast([2, 4, 6], [1, 2, 3]).estimate == pytest.approx(2)
    assert contrast([2, 4, 0], [1, 2, 3]).scale == "difference"
    assert contrast([2, 4, 0], [1, 1, 1]).estimate == pytest.approx(1)


def test_alike_needs_evidence() -> None:
    """Small differences in many pairs are alike; few pairs or a wide spread show neither; large ones are beyond."""
    base = np.linspace(10, 20, 12)
    alike = contrast(base * 1.01, base, margin=1.1)
    assert alike.p_alike is not None
    assert alike.p_alike < 0.001
    few = contrast([10.1, 20.2], [10, 20], margin=1.1)
    assert few.p_alike is not None
    assert few.p_alike > 0.05
    beyond = contrast(base * 1.5, base, margin=1.1)
    assert beyond.p_beyond is not None
    assert beyond.p_beyond < 0.001


def test_pairs_with_a_missing_value_are_left_out_and_counted() -> None:
    """And nothing at all gives no estimate."""
    found = contrast([1, None, 3, math.nan], [1, 2, None, 4])
    assert (found.n, found.missing) == (1, 3)
    nothing = contrast([], [])
    assert (nothing.n, nothing.p, nothing.estimate) == (0, 1.0, None)


@pytest.mark.parametrize(
    ("a", "b", "margin"), [([1], [1, 2], None), ([math.inf], [1], None), ([1], [1], 0.9), ([0], [1], -1.0)]
)
def test_impossible_samples_and_margins_are_refused(a: list[float], b: list[float], margin: float | None) -> None:
    """Samples of different lengths, infinite values, margins that are none."""
    with pytest.raises(ValueError, match="must"):
        contrast(a, b, margin=margin)


def test_the_medians_interval_is_made_of_order_statistics() -> None:
    """Of 20 values the 6th and the 15th (binomial); five values cannot give one."""
    found = describe(range(1, 21))
    assert (found.median, found.low, found.high) == (10.5, 6, 15)
    assert describe([1, 2, 3, 4, 5]).low is None
    assert describe([None, math.nan]).n == 0


@given(st.lists(st.floats(0, 1), min_size=1, max_size=6))
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
    assert holm(p) == pytest.approx(expected)


def test_how_many_pairs_are_needed() -> None:
    """6 pairs can show nothing under Holm over 7 comparisons; 9 can."""
    assert smallest_p(6) * 7 > 0.05
    assert pairs_needed(7) == 9
    assert pairs_needed(1) == 6
