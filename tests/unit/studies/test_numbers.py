"""The numbers behind verdicts against textbooks, SciPy, and sums done by hand; verdicts at both sides of each limit."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats as scipy_stats

from deltaswarm_studies import stats
from deltaswarm_studies.contrasts import contrasts_of, smallest_effects
from tests.support.studying import OWN, SWEEP, made
from tests.support.tiers import in_one_test
from tests.support.verdicts import NOISE, ONE, noisy, runs_with, walsh

# Statistics


@in_one_test(
    ("pairs", "alpha", "critical"),
    [(6, 0.05, 0), (8, 0.05, 3), (10, 0.05, 8), (12, 0.05, 13), (15, 0.05, 25), (20, 0.05, 52), (10, 0.01, 3),
     (12, 0.01, 7), (20, 0.01, 37)],
)  # fmt: skip
def test_the_critical_values_are_those_of_wilcoxons_table(pairs: int, alpha: float, critical: int) -> None:
    """The largest signed-rank sum that is significant on two sides, as any textbook lists it."""
    assert stats.rejected_walsh(pairs, alpha) == critical + 1


def test_five_pairs_can_reject_nothing() -> None:
    assert stats.rejected_walsh(5, 0.05) == 0
    assert stats.contrast([2, 3, 4, 5, 6], [1, 1, 1, 1, 1], "difference").interval(0.05) == (-math.inf, math.inf)


@in_one_test(("family", "pairs"), [(1, 6), (2, 7), (3, 7), (4, 8), (7, 9), (12, 9), (13, 10), (26, 11)])
def test_the_pairs_that_a_family_needs(family: int, pairs: int) -> None:
    """The first number of pairs for which 2 / 2^pairs times the family is at most 0.05."""
    assert stats.pairs_needed(family) == pairs


def test_smallest_p_of_few_pairs() -> None:
    assert [stats.smallest_p(pairs) for pairs in (1, 2, 3, 6)] == [1.0, 0.5, 0.25, 0.03125]


def test_a_contrast_is_hodges_and_lehmanns_estimate_with_its_interval() -> None:
    """Ten ratios: the median Walsh average, the 9th from either end at 0.05, and scipy's p, one-sided too."""
    found = stats.contrast(np.exp(NOISE), np.ones(10))
    averages = walsh(np.array(NOISE))
    assert found.estimate == pytest.approx(math.exp(np.median(averages)))
    assert found.interval(0.05) == pytest.approx((math.exp(averages[8]), math.exp(averages[-9])))
    assert found.interval(0.01) == pytest.approx((math.exp(averages[3]), math.exp(averages[-4])))
    for null in (1.0, 1.2, 0.9):
        shifted = np.array(NOISE) - math.log(null)
        p = {side: scipy_stats.wilcoxon(shifted, alternative=side).pvalue for side in ("two-sided", "greater", "less")}
        assert found.p(null) == pytest.approx(p["two-sided"])
        assert found.p_above(null) == pytest.approx(p["greater"])
        assert found.p_below(null) == pytest.approx(p["less"])
    ranks = scipy_stats.rankdata(np.abs(NOISE))
    signed = float(np.sum(ranks * np.sign(NOISE)))
    assert found.effect == pytest.approx(signed / 55)
    assert (found.none, stats.contrast([0, 1], [1, 1]).none) == (1.0, 0.0)


def test_differences_of_nothing_are_no_evidence() -> None:
    """Neither for more nor for less; a difference that is exactly the one asked about counts on no side."""
    found = stats.contrast([5, 6, 7, 8, 9, 3], [5, 6, 7, 8, 9, 3], "difference")
    assert (found.p_above(), found.p_below(), found.p(), found.effect) == (1.0, 1.0, 1.0, 0.0)
    shifted = stats.contrast([7, 8, 9, 10, 11, 5], [5, 6, 7, 8, 9, 3], "difference")
    assert (shifted.p_above(2.0), shifted.p_below(2.0), shifted.p(2.0)) == (1.0, 1.0, 1.0)
    assert (shifted.p_above(), shifted.p_below()) == (1 / 64, 1.0)


def test_a_margin_is_tested_by_the_worse_of_two_one_sided_tests() -> None:
    """Twice its p; beyond the margin, twice the better one's."""
    found = stats.contrast(np.exp(NOISE), np.ones(10))
    above = scipy_stats.wilcoxon(np.array(NOISE) + math.log(1.5), alternative="greater").pvalue
    below = scipy_stats.wilcoxon(np.array(NOISE) - math.log(1.5), alternative="less").pvalue
    assert found.p_within(1.5) == pytest.approx(2 * max(above, below))
    above = scipy_stats.wilcoxon(np.array(NOISE) - math.log(1.05), alternative="greater").pvalue
    assert found.p_beyond(1.05) == pytest.approx(2 * above)
    assert found.p_within(1.001) == found.p_beyond(100.0) == 1.0


@pytest.mark.parametrize("pairs", [300, 301])
def test_up_to_300_pairs_p_is_exact(pairs: int) -> None:
    """And scipy's normal approximation with more; seed 4."""
    values = np.random.default_rng(4).normal(0.1, 1, pairs)
    method = "exact" if pairs == 300 else "asymptotic"
    expected = scipy_stats.wilcoxon(values, method=method, correction=True).pvalue
    assert stats.contrast(values, np.zeros(pairs), "difference").p() == pytest.approx(expected, rel=1e-9)


def test_holms_procedure_by_hand() -> None:
    """0.01 passes at 0.05 / 3; 0.03 fails at 0.05 / 2, at which 0.04 is tested as well."""
    adjusted, alphas = zip(*stats.holm([0.01, 0.04, 0.03]), strict=True)
    assert adjusted == pytest.approx((0.03, 0.06, 0.06))
    assert alphas == pytest.approx((0.05 / 3, 0.025, 0.025))
    adjusted, alphas = zip(*stats.holm([0.01, 0.02, 0.9]), strict=True)
    assert adjusted == pytest.approx((0.03, 0.04, 0.9))
    assert alphas == pytest.approx((0.05 / 3, 0.025, 0.05))
    assert stats.holm([0.8, 0.9]) == [(1.0, 0.025), (1.0, 0.025)]


def test_the_smallest_effect_by_hand() -> None:
    """Of 20 pairs with a spread of 2: (2.0930 + 0.8416) x 2 / sqrt(3 / pi x 20); in a family, a smaller alpha."""
    assert stats.smallest_effect(2.0, 20, 1) == pytest.approx(1.34302, abs=1e-4)
    assert stats.smallest_effect(2.0, 20, 5) == pytest.approx((2.8609 + 0.8416) * 2 / 4.37019, abs=1e-4)
    assert stats.smallest_effect(2.0, 6, 1) < math.inf == stats.smallest_effect(2.0, 5, 1)


def test_six_values_give_a_median_an_interval() -> None:
    """From the smallest to the largest (97 %); five give none (94 %)."""
    found = stats.describe([5, 1, 2, 3, 9, 4])
    assert (found.n, found.missing, found.median, found.low, found.high) == (6, 0, 3.5, 1, 9)
    few = stats.describe([1, 2, 3, 4, 5, None])
    assert (few.n, few.missing, few.median, few.low, few.high, few.q1, few.q3) == (5, 1, 3, None, None, 2, 4)
    assert stats.median_interval(np.arange(5.0), 0.05) == (-math.inf, math.inf)
    nothing = stats.describe([None])
    assert (nothing.n, nothing.missing, nothing.median, nothing.low, nothing.q3) == (0, 1, None, None, None)


# Contrasts


def test_every_number_of_a_contrasts_row() -> None:
    """In a family of two alike rows, so that both are tested at 0.025."""
    found = contrasts_of(made(OWN + ONE + "margin = 1.3\n"), runs_with(made(OWN), noisy))
    p = scipy_stats.wilcoxon(NOISE).pvalue
    averages = walsh(np.array(NOISE))
    row = found.iloc[0]
    assert (row["contrast"], row["metric"], row["level"], row["reference"]) == (
        "c",
        "waiting_all",
        "loss=0.9",
        "loss=0.0",
    )
    assert (row["within"], row["scale"], row["n"], row["missing"], row["family"]) == (
        "decentralised",
        "ratio",
        10,
        0,
        2,
    )
    assert row["estimate"] == pytest.approx(math.exp(np.median(averages)))
    assert (row["p"], row["p_holm"]) == (pytest.approx(p), pytest.approx(2 * p))
    assert row["effect"] == pytest.approx(1 - 4 * scipy_stats.wilcoxon(NOISE).statistic / 110)
    assert (row["margin"], row["verdict"]) == (1.3, "unclear")
    assert row["confidence"] == pytest.approx(1 - 0.05 / 2)
    cut = 6  # at 0.025 on two sides, sums of up to 5 of 55 are significant: P(T <= 5) = 10 / 1024 <= 0.0125
    assert (row["low"], row["high"]) == pytest.approx((math.exp(averages[cut - 1]), math.exp(averages[-cut])))


@pytest.mark.parametrize(("replicates", "verdict"), [(6, "unclear"), (7, "alike")])
def test_alike_needs_the_alpha_of_the_row(replicates: int, verdict: str) -> None:
    """Two rows: at 0.025. Ratios within the margin give 2 / 2^6 = 0.031 with six replicates, 0.016 with seven."""
    study = made(OWN + ONE + "margin = 1.1\n")
    runs = runs_with(
        study, lambda level, _, r: (20.0 + r) * (1.01 ** ((-1) ** r * (r + 1)) if level == "loss=0.9" else 1)
    )
    found = contrasts_of(study, runs[runs["replicate"] < replicates])
    assert found["verdict"].tolist() == [verdict] * 2


def test_differences_have_a_margin_too() -> None:
    """A value of 0 makes the family one of differences; being alike is still a matter of ratios."""
    study = made(OWN + ONE + "margin = 1.1\n")
    alike = contrasts_of(study, runs_with(study, lambda level, _, r: float(r) * (1.01 if level == "loss=0.9" else 1)))
    assert alike["scale"].tolist() == ["difference"] * 2
    assert alike["verdict"].tolist() == ["slightly higher"] * 2
    found = contrasts_of(study, runs_with(study, lambda level, _, r: float(r) + (5 if level == "loss=0.9" else 0)))
    assert found["scale"].tolist() == ["difference"] * 2
    assert found["margin"].tolist() == [1.1] * 2
    assert found[["estimate", "low", "high", "effect"]].to_numpy().tolist() == [[5.0, 5.0, 5.0, 1.0]] * 2
    assert found["verdict"].tolist() == ["higher"] * 2


@pytest.mark.parametrize(("least", "estimate", "scale"), [(20.0, 2.0, "ratio"), (0.0, 1.5, "difference")])
def test_an_interaction_by_hand(least: float, estimate: float, scale: str) -> None:
    """Three times as much in one mode, 1.5 times in the other: twice the change; or 3 more and 1.5 more."""
    across = 'across = "mode"\nacross_pairs = [["hybrid 3", "decentralised"]]\n'
    study = made(OWN + ONE + across)

    def value(level: str, mode: str, replicate: int) -> float:
        start = (least + replicate) * (2 if mode == "hybrid 3" else 1)
        if level != "loss=0.9":
            return start
        factor = 3.0 if mode == "hybrid 3" else 1.5
        return start * factor if scale == "ratio" else start + factor

    [row] = contrasts_of(study, runs_with(study, value)).to_dict("records")
    assert (row["scale"], row["verdict"], row["n"]) == (scale, "higher", 10)
    assert (row["estimate"], row["within"]) == (pytest.approx(estimate), "hybrid 3 against decentralised")


@pytest.mark.parametrize(("replicates", "is_known"), [(2, False), (3, True)])
def test_a_pilots_effect_by_hand(replicates: int, is_known: bool, tmp_path: Path) -> None:
    """From three pairs on: the spread of the logarithms, ten planned replicates, two comparisons."""
    study = made(OWN + ONE)
    runs = runs_with(study, noisy)
    runs[runs["replicate"] < replicates].to_csv(tmp_path / "runs.csv", index=False)
    [(key, shown)] = smallest_effects(study, tmp_path / "runs.csv").items()
    assert key == (0, "waiting_all")
    quantiles = scipy_stats.t.isf(0.0125, 9) + 0.841621
    shift = quantiles * np.std(NOISE[:replicates], ddof=1) / math.sqrt(3 / math.pi * 10)
    assert shown == (f"{math.exp(shift):.2f} times" if is_known else None)
    for repeats in (6, 7):  # two comparisons need seven
        fewer = made(OWN + ONE, SWEEP.replace("repeats = 10", f"repeats = {repeats}"))
        [shown] = smallest_effects(fewer, tmp_path / "runs.csv").values()
        assert (shown is not None) == (is_known and repeats == 7)


def test_a_pilots_effect_on_a_scale_of_differences(tmp_path: Path) -> None:
    """With a value of 0, in the metric's unit with three digits."""
    study = made(OWN + ONE)
    runs = runs_with(study, lambda level, _, r: float(r) + (NOISE[r] if level == "loss=0.9" else 0))
    runs.to_csv(tmp_path / "runs.csv", index=False)
    quantiles = scipy_stats.t.isf(0.0125, 9) + 0.841621
    shift = quantiles * np.std(NOISE, ddof=1) / math.sqrt(3 / math.pi * 10)
    assert list(smallest_effects(study, tmp_path / "runs.csv").values()) == [f"{shift:.3g} s"]
