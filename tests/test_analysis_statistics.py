"""Statistics: published values, what holds for every sample, and how a sweep's variants are paired."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltaswarm_orchestrator.analysis import intervals
from deltaswarm_orchestrator.analysis.intervals import TINY
from deltaswarm_orchestrator.analysis.ranks import mann_whitney, smallest_p, wilcoxon
from deltaswarm_orchestrator.analysis.statistics import (
    Comparison,
    compare,
    compare_all,
    describe,
    holm,
    samples,
    summarise,
    tost,
)

DARWIN_CROSSED = [23.5, 12.0, 21.0, 22.0, 19.125, 21.5, 22.125, 20.375, 18.25, 21.625, 23.25, 21.0, 22.125, 23.0, 12.0]
DARWIN_SELFED = [17.375, 20.375, 20.0, 20.0, 18.375, 18.625, 18.625, 15.25, 16.5, 18.0, 16.25, 18.0, 12.75, 15.5, 18.0]
"""Heights of maize [inch] from Darwin (1876): rank sums 96 and 24, exact p = 0.04126 in scipy's documentation."""

MALES, FEMALES = [19.0, 22.0, 16.0, 29.0, 24.0], [20.0, 11.0, 17.0, 12.0]
"""Wikipedia's and scipy's example of Mann-Whitney's U: U = 17 and 3, exact two-sided p = 0.111."""

values = st.floats(min_value=-1e4, max_value=1e4).map(lambda value: round(value, 3))
several = st.lists(values, min_size=2, max_size=12)
pairs = st.lists(st.tuples(values, values), min_size=2, max_size=12)
few = settings(max_examples=30, deadline=None)


def test_mann_whitney_has_the_published_p() -> None:
    """The example by hand: U = 17 of 20, p = 0.111, and Cliff's delta by counting pairs."""
    found = compare(MALES, FEMALES, paired=False)
    assert found.statistic == 17
    assert found.p == pytest.approx(2 * 7 / math.comb(9, 4))
    larger = sum(a > b for a in MALES for b in FEMALES)
    assert found.effect == pytest.approx((larger - (20 - larger)) / 20)
    assert found.effect_name == "Cliff's delta"
    assert found.test == "Mann-Whitney U, exact"


def test_wilcoxon_has_the_published_rank_sum() -> None:
    """Darwin's maize: the positive differences have the rank sum 96 of 120, and p = 0.041 exactly."""
    found = compare(DARWIN_CROSSED, DARWIN_SELFED, paired=True)
    assert found.statistic == 96
    assert found.p == pytest.approx(0.041259765625)
    assert found.effect == pytest.approx(2 * 96 / 120 - 1)
    assert found.effect_name == "matched-pairs rank-biserial"


def exact_by_enumeration(differences: Sequence[float]) -> float:
    """Wilcoxon's two-sided p over all signs, written from the definition."""
    moved = [d for d in differences if d]
    sizes = sorted(abs(d) for d in moved)
    ranks = [np.mean([i + 1 for i, size in enumerate(sizes) if size == abs(d)]) for d in moved]
    sums = [
        sum(r for r, up in zip(ranks, ups, strict=True) if up) for ups in itertools.product((0, 1), repeat=len(ranks))
    ]
    seen = sum(r for r, d in zip(ranks, moved, strict=True) if d > 0)
    below = sum(s <= seen + 1e-9 for s in sums) / len(sums)
    above = sum(s >= seen - 1e-9 for s in sums) / len(sums)
    return min(1.0, 2 * min(below, above))


@few
@given(st.lists(st.integers(-6, 6), min_size=1, max_size=8).filter(any))
def test_small_paired_samples_are_tested_exactly(differences: list[int]) -> None:
    """Also with ties and zeros."""
    found = compare(differences, [0] * len(differences), paired=True)
    assert found.p == pytest.approx(exact_by_enumeration(differences))
    assert "exact" in found.test


def test_critical_values_of_the_signed_rank_table() -> None:
    """The table for n = 8 at 5 % two-sided: a smaller rank sum of 3 is significant (p = 0.039), of 4 is not."""
    ranks = np.arange(1.0, 9.0)
    for negative, p in (([3], 10 / 256), ([4], 14 / 256), ([], 2 / 256)):
        signs = np.where(np.isin(ranks, negative), -1, 1)
        assert compare(ranks * signs, np.zeros(8), paired=True).p == pytest.approx(p)


def test_values_that_are_all_equal_show_nothing() -> None:
    """No p below 1, the effect 0 and the interval of the difference has no width."""
    for paired in (True, False):
        found = compare([3.0] * 6, [3.0] * 6, paired=paired)
        assert (found.p, found.effect, found.difference, found.low, found.high) == (1.0, 0.0, 0.0, 0.0, 0.0)
        assert (found.ratio, found.ratio_low, found.ratio_high) == (1.0, 1.0, 1.0)


def test_nothing_is_no_evidence() -> None:
    """Without values p is 1 and there are no figures; with one pair there is a difference but no interval."""
    for paired in (True, False):
        none = compare([], [], paired=paired)
        assert (none.p, none.difference, none.effect, none.ratio, none.low) == (1.0, None, None, None, None)
        one = compare([5.0], [4.0], paired=paired)
        assert (one.p, one.difference, one.low, one.ratio, one.ratio_low) == (1.0, 1.0, None, 1.25, None)


def both_ways(a: Sequence[float], b: Sequence[float], paired: bool) -> tuple[Comparison, Comparison]:
    """Compare two samples, then the other way round. 199 resamples mirror one another as well as 4999 do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(intervals, "RESAMPLES", 199)
        return compare(a, b, paired=paired), compare(b, a, paired=paired)


@few
@given(pairs, st.booleans())
def test_a_comparison_turned_round_is_its_mirror_image(both: list[tuple[float, float]], paired: bool) -> None:
    """Same p; differences, effects and their intervals change sign."""
    a, b = [x for x, _ in both], [y for _, y in both]
    there, back = both_ways(a, b, paired)
    assert there.p == pytest.approx(back.p)
    assert there.effect == pytest.approx(-(back.effect or 0), abs=1e-9)
    assert there.difference == pytest.approx(-(back.difference or 0), abs=1e-6)
    assert there.low == pytest.approx(-(back.high or 0), abs=1e-6)


positive = st.integers(1, 50).map(float)


@few
@given(st.lists(st.tuples(positive, positive), min_size=2, max_size=12), st.booleans())
def test_a_ratio_turned_round_is_its_reciprocal(both: list[tuple[float, float]], paired: bool) -> None:
    """With its interval; where a value is not above 0 there is none."""
    a, b = [x for x, _ in both], [y for _, y in both]
    there, back = both_ways(a, b, paired)
    assert there.ratio == pytest.approx(np.median(a) / np.median(b))
    assert there.ratio_low <= there.ratio <= there.ratio_high  # type: ignore[operator]
    assert there.ratio_low == pytest.approx(1 / back.ratio_high)  # type: ignore[operator]
    assert there.ratio_high == pytest.approx(1 / back.ratio_low)  # type: ignore[operator]
    assert both_ways([0.0, *a[1:]], b, paired)[0].ratio is None


@few
@given(st.lists(st.tuples(values, values), min_size=1, max_size=7))
def test_one_sided_tests_share_the_evidence(both: list[tuple[float, float]]) -> None:
    """What supports "greater" opposes "less", and two-sided is never stronger than the better side."""
    a, b = np.array([x for x, _ in both]), np.array([y for _, y in both])
    for test in (lambda side: wilcoxon(a - b, side).p, lambda side: mann_whitney(a, b, side).p):
        assert test("greater") + test("less") >= 1 - 1e-9
        assert test("two-sided") >= min(test("greater"), test("less")) - 1e-9


@few
@given(several)
def test_the_interval_holds_the_median(sample: list[float]) -> None:
    """And lies within the sample; quartiles enclose the median too; the same seed gives the same again."""
    found = describe(sample)
    assert found == describe(sample)
    assert None not in (found.median, found.low, found.high, found.q1, found.q3)
    assert found.low <= found.median <= found.high  # type: ignore[operator]
    rounding = 1e-9  # scipy interpolates between the resampled medians
    assert min(sample) - rounding <= found.low <= found.high <= max(sample) + rounding  # type: ignore[operator]
    assert found.q1 <= found.median <= found.q3  # type: ignore[operator]
    assert found.median == np.median(sample)


def test_an_interval_covers_the_truth_about_as_often_as_it_says() -> None:
    """Of 100 samples of 15 exponential waiting times, 88 to 100 intervals at 95 % hold the true median."""
    rng = np.random.default_rng(7)
    truth = 30 * math.log(2)
    intervals = [describe(rng.exponential(30, 15)) for _ in range(100)]
    covered = sum(found.low <= truth <= found.high for found in intervals)  # type: ignore[operator]
    assert 88 <= covered < 100


def test_a_larger_confidence_gives_a_wider_interval() -> None:
    """A test that the argument arrives."""
    wide, narrow = describe(range(20), confidence=0.99), describe(range(20), confidence=0.5)
    assert wide.low < narrow.low <= narrow.high < wide.high  # type: ignore[operator]
    with pytest.raises(ValueError, match="confidence"):
        describe([1.0, 2.0], confidence=95)


def test_samples_too_small_for_bca_still_have_an_interval() -> None:
    """Below TINY values it is the percentile interval, with TINY it need not be."""
    for n in (2, TINY - 1, TINY):
        found = describe([float(k * k) for k in range(n)])
        assert found.low is not None
        assert found.high is not None
        assert found.low < found.high


def test_none_one_and_constant_values_are_described_clearly() -> None:
    """Missing values are counted and in no figure."""
    assert describe([]).median is None
    one = describe([4.5, None, math.nan])
    assert (one.n, one.missing, one.median, one.iqr, one.low) == (1, 2, 4.5, 0.0, None)
    same = describe([0.1] * 9)
    assert (same.median, same.low, same.high, same.mean) == (0.1, 0.1, 0.1, 0.1)
    with pytest.raises(ValueError, match="infinite"):
        describe([1.0, math.inf])


def test_a_pair_with_a_missing_value_is_left_out_whole() -> None:
    """Else the values behind it would meet the wrong partners."""
    found = compare([1.0, None, 3.0, 4.0], [0.0, 100.0, 2.0, None], paired=True)
    assert (found.n_a, found.missing, found.difference) == (2, 2, 1.0)
    with pytest.raises(ValueError, match="one length"):
        compare([1.0], [1.0, 2.0], paired=True)


def holm_by_closure(p_values: Sequence[float]) -> list[float]:
    """Holm from its definition: the largest Bonferroni p of all subsets of hypotheses that hold the one."""
    numbers = range(len(p_values))
    subsets = [s for n in numbers for s in itertools.combinations(numbers, n + 1)]
    return [min(1.0, max(len(s) * min(p_values[j] for j in s) for s in subsets if i in s)) for i in numbers]


@given(st.lists(st.floats(0, 1), max_size=6))
def test_holm_is_the_closure_of_bonferroni(p_values: list[float]) -> None:
    """So it is never below the raw p, never above 1, and keeps their order."""
    adjusted = holm(p_values)
    assert adjusted == pytest.approx(holm_by_closure(p_values))
    for raw, corrected in zip(p_values, adjusted, strict=True):
        assert raw <= corrected <= 1
    ordered = [corrected for _, corrected in sorted(zip(p_values, adjusted, strict=True))]
    assert ordered == sorted(ordered)


def test_holm_of_a_known_example() -> None:
    """Four p-values, adjusted by hand."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    with pytest.raises(ValueError, match="between 0 and 1"):
        holm([0.5, math.nan])


@pytest.mark.parametrize("paired", [True, False])
def test_equivalence_needs_a_margin_wider_than_the_spread(paired: bool) -> None:
    """Alike within 1, not within 0.001; and what differs is not alike, however large the sample."""
    rng = np.random.default_rng(3)
    a = rng.normal(40, 0.2, 20)
    b = a + rng.normal(0, 0.05, 20)
    assert tost(a, b, 1.0, paired=paired).p < 0.001
    assert tost(a, b, 0.001, paired=paired).p > 0.2
    assert tost(a, b + 2, 1.0, paired=paired).p > 0.99
    with pytest.raises(ValueError, match="margin"):
        tost(a, b, 0.0, paired=paired)


def test_the_smallest_p_is_reached_when_all_point_one_way() -> None:
    """And by nothing below it."""
    a, b = [5.0, 6.0, 8.0, 11.0], [1.0, 1.5, 2.5, 4.0]
    for paired in (True, False):
        assert compare(a, b, paired=paired).p == pytest.approx(smallest_p(4, 4, paired=paired))


def a_table(seeds: Sequence[int] = (11, 12, 13, 14, 15, 16)) -> pd.DataFrame:
    """Two variants of six replicates; `slow` waits 10 s longer in each, and its rows are in another order."""
    quick = [{"variant": "quick", "replicate": r, "seed": 11 + r, "wait": 20.0 + r * r} for r in range(6)]
    slow = [{"variant": "slow", "replicate": r, "seed": seeds[r], "wait": 30.0 + r * r} for r in range(6)]
    return pd.DataFrame([*quick, *reversed(slow)])


def test_variants_with_the_same_seeds_are_compared_pair_by_pair() -> None:
    """By replicate, not by row: in each pair the difference is 10 s."""
    (row,) = compare_all(a_table(), "wait", "quick").to_dict("records")
    assert row["paired"]
    assert (row["variant"], row["difference"], row["low"], row["high"], row["effect"]) == ("slow", 10, 10, 10, 1)
    assert row["p"] == row["p_holm"] == pytest.approx(2 / 2**6)


def test_variants_with_other_seeds_are_not_paired() -> None:
    """One seed that differs is enough."""
    found = samples(a_table(seeds=(11, 12, 13, 14, 15, 99)), "wait", "slow", "quick")
    assert not found.paired
    assert len(found.a) == len(found.b) == 6


def test_a_replicate_that_only_one_variant_has_is_left_out_of_the_pairs() -> None:
    """A failed run costs its pair, not the pairing."""
    table = a_table()
    found = samples(table[~((table["variant"] == "slow") & (table["replicate"] == 2))], "wait", "slow", "quick")
    assert found.paired
    assert [a - b for a, b in zip(found.a, found.b, strict=True)] == [10.0] * 5


def test_p_values_are_corrected_over_the_variants() -> None:
    """Three comparisons: the smallest is tripled."""
    table = pd.concat([a_table(), *(a_table()[lambda t: t["variant"] == "slow"].assign(variant=v) for v in ("x", "y"))])
    compared = compare_all(table, "wait", "quick")
    assert list(compared["variant"]) == ["slow", "x", "y"]
    assert compared["p_holm"].tolist() == pytest.approx([3 * 2 / 2**6] * 3)


def test_what_the_table_lacks_is_said_by_name() -> None:
    """A figure, a variant; and a replicate that is there twice."""
    table = a_table()
    for figure, reference, message in (("wat", "quick", "'wat'"), ("wait", "quack", "'quack'")):
        with pytest.raises(ValueError, match=message):
            compare_all(table, figure, reference)
    with pytest.raises(ValueError, match="twice"):
        summarise(pd.concat([table, table]), ["wait"])


def test_a_summary_has_a_row_for_each_variant_and_figure() -> None:
    """None in a column of numbers counts as missing."""
    table = a_table().assign(area=[None, *range(11)])
    rows = summarise(table, ["wait", "area"]).set_index(["variant", "figure"])
    assert list(rows.index) == [("quick", "wait"), ("quick", "area"), ("slow", "wait"), ("slow", "area")]
    assert rows.loc[("quick", "wait"), "median"] == np.median([20, 21, 24, 29, 36, 45])
    assert rows.loc[("quick", "area"), "missing"] == 1
