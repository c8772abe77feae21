"""Verdicts beside others: contradicting outcomes, references that meet a criterion too, trends, and runs to decide."""

import math

import numpy as np
import pytest
from scipy import stats as scipy_stats

from deltaswarm_studies import stats
from deltaswarm_studies.claims import claims_of
from deltaswarm_studies.contrasts import contrasts_of
from deltaswarm_studies.deciding import POWER, from_edges, open_contrast, runs_needed
from tests.support.studying import FAST, OWN, SAME, SLOW, made
from tests.support.tiers import in_one_test
from tests.support.verdicts import ONE, TWO_CLAIMS, noisy, runs_with

ORDER = TWO_CLAIMS.format("o", f'less = "{SAME}"\nmore = "{SLOW}"')


def shorter(level: str, _mode: str, replicate: int) -> float:
    return (20.0 + replicate) * (0.9 if level == "loss=0.9" else 1)


def longer(level: str, _mode: str, replicate: int) -> float:
    return (20.0 + replicate) * (1.1 if level == "loss=0.9" else 1)


@in_one_test(("few", "is_contradicted"), [(6, False), (10, True)])
def test_waiting_that_both_counts_order_differently_depends_on_the_metric(few: int, is_contradicted: bool) -> None:
    """Sensed events say less, all events say more, in claims and in contrasts; six of a family of two prove nothing."""
    study = made(OWN + ONE + ORDER)
    runs = runs_with(study, longer, sensed=shorter)
    runs = runs[runs["replicate"] < few]
    assert set(contrasts_of(study, runs)["verdict"]) == {"depends on the metric" if is_contradicted else "unclear"}
    if is_contradicted:
        assert claims_of(study, runs)["verdict"].tolist() == ["depends on the metric"]
        assert claims_of(study, runs.drop(columns="waiting"))["verdict"].tolist() == ["holds"]
    agreeing = runs_with(study, longer, sensed=longer)
    assert claims_of(study, agreeing)["verdict"].tolist() == ["holds"]


def test_another_count_that_decides_nothing_contradicts_nothing() -> None:
    study = made(OWN + ONE)
    runs = runs_with(study, lambda level, _, r: (20.0 + r) * ((0.95, 1.06)[r % 2] if level == "loss=0.9" else 1),
                     sensed=shorter)  # fmt: skip
    lower = made(OWN + ONE.replace('"waiting_all"', '"waiting"'))
    assert contrasts_of(lower, runs)["verdict"].tolist() == ["lower"] * 2


def test_outcomes_of_one_question_must_not_contradict_each_other() -> None:
    """One criterion is met and the other is not: both depend on the metric, and a third question is left alone."""
    value = 'kind = "value"\nof = "{}"\nwithin = [{}]\nquestion = "{}"'
    own = TWO_CLAIMS.format("a", value.format(SAME, "15, 40", "q")) + TWO_CLAIMS.format(
        "b", value.format(SAME, "50, 60", "q")
    )
    own += TWO_CLAIMS.format("c", value.format(SAME, "15, 40", "other"))
    own += TWO_CLAIMS.format("d", value.format(SAME, "15, 25", "q"))
    study = made(OWN + own)
    verdicts = claims_of(study, runs_with(study, noisy))["verdict"].tolist()
    assert verdicts == ["depends on the metric"] * 2 + ["holds", "undecided"]


@in_one_test(("within", "verdict"), [("15, 40", "holds anyway"), ("15, 25", "undecided"), ("20, 29", "holds anyway")])
def test_what_the_reference_meets_too_holds_anyway(within: str, verdict: str) -> None:
    """Without loss, as under it, the ten values are 20 to 29."""
    value = f'kind = "value"\nof = "{SAME}"\nwithin = [{within}]\nreference = "loss=0.5, hybrid 3"'
    study = made(OWN + TWO_CLAIMS.format("v", value))
    assert claims_of(study, runs_with(study, noisy))["verdict"].tolist() == [verdict]
    other = runs_with(study, lambda level, _, r: 20.0 + r + 100 * (level == "loss=0.5"))
    assert claims_of(study, other)["verdict"].tolist() == [verdict.removesuffix(" anyway")]


ALONG = ("loss=0.0, hybrid 3", "loss=0.5, hybrid 3", "loss=0.9, hybrid 3")
RISING = {level: size for size, level in enumerate(("loss=0.0", "loss=0.5", "loss=0.9"))}


@pytest.mark.parametrize(("slope", "verdict"), [(0.3, "holds"), (-0.3, "refuted"), (0.0, "undecided")])
def test_a_trend_over_ordered_levels_is_one_test(slope: float, verdict: str) -> None:
    """Its verdict is that of the test by Page, its estimate near the mean rank correlation."""
    generator = np.random.default_rng(3)
    noise = {(level, r): generator.normal(0, 0.08) for level in RISING for r in range(10)}
    study = made(OWN + TWO_CLAIMS.format("t", f'kind = "trend"\nalong = {list(ALONG)}'))
    runs = runs_with(study, lambda level, _, r: math.exp(slope * RISING[level] + noise[level, r]))
    row = claims_of(study, runs).iloc[0]
    values = runs[runs["variant"].isin(ALONG)].pivot(index="replicate", columns="variant", values="waiting_all")
    ordered = values[list(ALONG)].to_numpy()
    up, down = (scipy_stats.page_trend_test(side, method="exact").pvalue for side in (ordered, ordered[:, ::-1]))
    assert (2 * min(up, down) <= 0.05) == (verdict != "undecided")
    assert row["verdict"] == verdict
    each = [scipy_stats.spearmanr([0, 1, 2], line).statistic for line in ordered]
    assert row["estimate"] == pytest.approx(np.mean(each), abs=0.35)
    assert row["p"] == pytest.approx(stats.contrast(each, [0.0] * 10, "difference").p())


def test_a_trend_without_any_difference_is_none() -> None:
    study = made(OWN + TWO_CLAIMS.format("t", f'kind = "trend"\nalong = {list(ALONG)}'))
    row = claims_of(study, runs_with(study, lambda *_: 5.0)).iloc[0]
    assert (row["verdict"], row["estimate"]) == ("undecided", 0.0)


def test_the_runs_that_are_said_to_decide_do_so_in_four_of_five_cases() -> None:
    """By the t-interval of 12 pairs with a shift of 0.3 standard deviations, and by 2,000 made-up studies; seed 5."""
    half = float(scipy_stats.norm.isf(0.025)) / math.sqrt(12)
    needed = runs_needed((0.3 - half, 0.3 + half), 12, 0.05, from_edges(0.3, [0.0]))
    assert needed == pytest.approx(((1.96 + 0.8416) / 0.3) ** 2, abs=1)
    drawn = np.random.default_rng(5).normal(0.3, 1.0, (2000, needed or 0))
    shown = scipy_stats.ttest_1samp(drawn, 0.0, axis=1).pvalue <= 0.05
    assert np.mean(shown) == pytest.approx(POWER, abs=0.03)


@in_one_test(
    ("estimate", "margin", "expected"),
    [
        (1.05, 1.1, ("too few runs", 90)),  # log 1.05 from none, log 1.1 - log 1.05 from the margin: the former
        (1.0, 1.1, ("too few runs", 26)),  # (1.96 + 1.2816)^2 (0.046)^2 12 / 0.0953^2
        (1.05, 0.0, ("no margin", 90)),
        (1.0, 0.0, ("cannot be closed", None)),
    ],
)
def test_why_a_contrast_is_open(estimate: float, margin: float, expected: tuple[str, int | None]) -> None:
    """With an interval of 1.0936 times to either side from 12 runs: a standard error of 0.0457."""
    side = 1.0936
    why, needed = open_contrast(estimate, (estimate / side, estimate * side), 12, 0.05, "ratio", margin, 1)
    assert why == expected[0]
    error = math.log(side) / 1.959964
    ways = [((1.959964 + 0.841621) * error / math.log(estimate)) ** 2] if estimate > 1 else []
    inside = math.log(margin or 1) - math.log(estimate)
    ways += [((1.959964 + 1.281552) * error / inside) ** 2] if inside > 0 else []
    assert needed == (math.ceil(12 * min(ways)) if ways else None)


def test_fewer_runs_than_any_test_needs_are_too_few() -> None:
    assert open_contrast(1.2, (-math.inf, math.inf), 5, 0.05, "ratio", 0.0, 4) == (
        "too few runs",
        stats.pairs_needed(4),
    )


def test_a_claim_says_how_many_runs_would_decide_it() -> None:
    """An order that the noise hides, and one whose value is nowhere near the edge of its tolerance."""
    study = made(
        OWN + TWO_CLAIMS.format("o", f'less = "{SAME}"\nmore = "{SLOW}"\nat_least = 1.2') + ORDER.replace('"o"', '"p"')
    )
    row, decided = (row for _, row in claims_of(study, runs_with(study, noisy)).iterrows())
    assert row["open"] == "too few runs"
    assert row["needed"] > 10
    assert (FAST, decided["open"]) == (FAST, "" if decided["verdict"] == "holds" else "too few runs")
