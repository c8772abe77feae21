"""Published numbers with their spread: against SciPy's Welch test, by hand, and what would decide them."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats as scipy_stats

from deltaswarm_studies.claims import claims_of
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.origin import run_s
from deltaswarm_studies.protocol import protocol_of
from deltaswarm_studies.protocol_page import Record
from deltaswarm_studies.verdicts import claims_tables, leave_one_out
from deltaswarm_studies.verdicts import tests as counted
from deltaswarm_studies.welch import Spread, Welch
from deltaswarm_wire.checked import SettingsError
from tests.support.studying import FAST, OWN, SAME, SLOW, made
from tests.support.tiers import in_one_test
from tests.support.verdicts import runs_with

PUBLISHED = '[[claim]]\nid = "p"\ntext = "Waiting"\nsays = "as told"\nmetric = "waiting_all"\nkind = "published"\n'
PUBLISHED += f'of = "{SAME}"\n'
VALUES = (18.0, 19.0, 20.5, 21.0, 22.0, 22.5, 23.0, 24.5, 26.0, 27.5)
"""Mean 22.4, median 22.25, quartiles 20.625 and 24.125."""


def row_of(text: str, values: tuple[float, ...] = VALUES) -> pd.Series:
    study = made(OWN + PUBLISHED + text)
    return claims_of(study, runs_with(study, lambda _level, _mode, replicate: values[replicate])).iloc[0]


@in_one_test(
    ("text", "published", "sd", "n"),
    [
        ("published = 20.0\nsd = 2.0\nn = 12\n", 20.0, 2.0, 12),
        ("published = 20.0\nse = 0.5\nn = 16\n", 20.0, 2.0, 16),
        ("published = 30.0\nsd = 9.0\nn = 5\n", 30.0, 9.0, 5),
        ("published = 22.4\nsd = 1.0\nn = 300\n", 22.4, 1.0, 300),
    ],
)
def test_a_mean_is_compared_as_scipys_welch_test_does(text: str, published: float, sd: float, n: int) -> None:
    row, ours = row_of(text), (np.mean(VALUES), np.std(VALUES, ddof=1), 10)
    expected = scipy_stats.ttest_ind_from_stats(*ours, published, sd, n, equal_var=False)
    assert row["p"] == pytest.approx(expected.pvalue)
    assert (row["ours"], row["published"], row["n"], row["published_n"]) == pytest.approx((22.4, published, 10, n))
    for end in (row["low"], row["high"]):  # the differences that SciPy would reject at exactly 0.05
        shifted = scipy_stats.ttest_ind_from_stats(*ours, published + end, sd, n, equal_var=False)
        assert shifted.pvalue == pytest.approx(0.05)
    assert row["verdict"] == ("differs" if expected.pvalue <= 0.05 else "undecided")


def test_medians_are_compared_by_their_interquartile_ranges() -> None:
    """As SciPy's test with standard deviations of which the standard errors of medians are made, by hand."""
    row = row_of("published = 20.0\niqr = 2.698\nn = 25\n")
    ours = (22.25, 1.2533 * 3.5 / 1.349, 10)
    expected = scipy_stats.ttest_ind_from_stats(*ours, 20.0, 1.2533 * 2.0, 25, equal_var=False)
    assert row["ours"] == 22.25
    assert row["p"] == pytest.approx(expected.pvalue)


def test_a_difference_of_the_papers_messages_is_one() -> None:
    """4.44 against 3.9 with interquartile ranges of about 0.5, 20 each: z = 3.7, which was once called undecided."""
    test = Welch(
        Spread(4.443, 1.2533 / 1.349 * 0.494 / math.sqrt(20), 20), Spread(3.9, 1.2533 / 1.349 * 0.5 / math.sqrt(20), 20)
    )
    assert test.difference / test.error == pytest.approx(3.7, abs=0.05)
    assert test.p() == pytest.approx(2 * scipy_stats.t.sf(test.difference / test.error, 38), rel=0.01)
    assert test.p() < 0.001


@in_one_test(
    ("text", "verdict"),
    [
        ("published = 22.0\nsd = 2.0\nn = 50\nwithin = [18.0, 26.0]\n", "agrees"),
        ("published = 22.0\nsd = 2.0\nn = 50\nwithin = [20.9, 23.1]\n", "undecided"),
        ("published = 22.0\nsd = 2.0\nn = 50\n", "undecided"),
        ("published = 17.0\nsd = 2.0\nn = 50\nwithin = [15.0, 19.0]\n", "differs"),
        ("published = 20.0\nsd = 0.5\nn = 50\nwithin = [10.0, 30.0]\n", "agrees"),  # and differs by less than that
    ],
)
def test_a_published_number_differs_agrees_or_is_undecided(text: str, verdict: str) -> None:
    """By the interval of the difference: without 0, within the tolerance, or neither; an agreement needs a margin."""
    row = row_of(text)
    assert row["verdict"] == verdict
    assert bool(row["p_holm"] <= 0.05) == (verdict != "undecided")


def test_equivalence_is_by_two_one_sided_tests() -> None:
    """Twice the larger p, so that verdict and interval agree; worked out with SciPy's t distribution."""
    test = Welch(Spread(10.2, 0.3, 12), Spread(10.0, 0.4, 9))
    error, freedom = 0.5, 0.5**4 / (0.3**4 / 11 + 0.4**4 / 8)
    above, below = scipy_stats.t.sf((0.2 + 1.0) / error, freedom), scipy_stats.t.sf((1.5 - 0.2) / error, freedom)
    assert test.p_within(-1.0, 1.5) == pytest.approx(2 * max(above, below))
    low, high = test.interval(2 * max(above, below))
    assert low == pytest.approx(-1.0)
    assert high < 1.5


@in_one_test(
    ("ours", "theirs", "region", "expected"),
    [
        # A one-sample t-test needs 34 to find half a standard deviation with 80 % (any table of sample sizes).
        (Spread(1.0, 2 / math.sqrt(20), 20), Spread(0.0, 1e-6, 1000), (math.nan, math.nan), 34),
        # And as many if ours is the smaller one.
        (Spread(-1.0, 2 / math.sqrt(20), 20), Spread(0.0, 1e-6, 1000), (math.nan, math.nan), 34),
        # Equal means are within half a standard deviation: (1.96 + 1.28)^2 * 4 = 42, and 3 more for t.
        (Spread(0.0, 2 / math.sqrt(20), 20), Spread(0.0, 1e-6, 1000), (-1.0, 1.0), 45),
        # The published number alone is uncertain by 0.5: a difference of 1 is 2 of its errors.
        (Spread(1.0, 0.1, 20), Spread(0.0, 0.5, 20), (math.nan, math.nan), None),
    ],
)
def test_the_number_that_would_decide(
    ours: Spread, theirs: Spread, region: tuple[float, float], expected: int | None
) -> None:
    """By hand and by tables of sample sizes; none where the published number is too uncertain."""
    found = Welch(ours, theirs).replicates(*region, 0.05)
    assert found == (None if expected is None else pytest.approx(expected, abs=1))


def test_the_number_that_would_decide_is_that_of_simulated_runs() -> None:
    """Of 4,000 simulated comparisons with so many replicates, 80 % find the difference; seed 7."""
    test = Welch(Spread(1.0, 2 / math.sqrt(12), 12), Spread(0.0, 1.5 / math.sqrt(60), 60))
    n = test.replicates(math.nan, math.nan, 0.05)
    assert n is not None
    generator = np.random.default_rng(7)
    ours, theirs = generator.normal(1.0, 2.0, (4000, n)), generator.normal(0.0, 1.5, (4000, 60))
    p = scipy_stats.ttest_ind(ours, theirs, axis=1, equal_var=False).pvalue
    assert np.mean(p <= 0.05) == pytest.approx(0.8, abs=0.02)


def test_where_only_both_sides_together_could_decide_that_is_said() -> None:
    """No number of ours alone, and so many on both sides: (1.96 + 0.84)^2 * (0.5^2 + 0.5^2) * 20 / 1 = 79."""
    test = Welch(Spread(1.0, 0.5, 20), Spread(0.0, 0.5, 20))
    assert test.replicates(math.nan, math.nan, 0.05) is None
    assert test.replicates(math.nan, math.nan, 0.05, of_both=True) == pytest.approx(79, abs=2)


def shown(text: str, run_s: float | None) -> dict[str, str]:
    study = made(OWN + PUBLISHED + text)
    claims = claims_of(study, runs_with(study, lambda _level, _mode, replicate: VALUES[replicate]))
    first = next(claims_tables(study, claims, run_s))
    return dict(zip(first.headings, first.rows[0], strict=True))


def test_the_page_shows_both_numbers_with_their_sizes_and_what_would_decide() -> None:
    """Replicates, how many more, and their time at the measured speed; a decided one has nothing to decide."""
    row = shown('published = 21.0\nsd = 2.0\nn = 40\nassumes = "n of the caption"\n', 9.5)
    needed = Welch(Spread.of(np.array(VALUES), is_median=False), Spread(21.0, 2 / math.sqrt(40), 40)).replicates(
        math.nan, math.nan, 0.05
    )
    assert needed is not None
    minutes, seconds = divmod(round((needed - 10) * 9.5), 60)
    told = f"{needed} replicates ({needed - 10} more, in about 0:{minutes:02}:{seconds:02})"
    assert row["To decide"] == f"{told}, for a difference only: no margin"
    assert row["Here"].startswith("22.4 (n = 10) against 21.0 (n = 40), difference 1.40 (1.12) [")
    assert row["Published"] == "as told (assumed: n of the caption)"
    assert row["Of what"].endswith(": frames lost [share]: 0.0, hybrid 3 less the published")
    assert "To decide" not in shown("published = 10.0\nsd = 2.0\nn = 40\n", 9.5)
    assert (
        shown("published = 21.0\nsd = 2.0\nn = 40\n", None)["To decide"]
        == f"{needed} replicates ({needed - 10} more), for a difference only: no margin"
    )
    uncertain = shown("published = 21.0\nsd = 6.0\nn = 10\n", 9.5)["To decide"]
    assert uncertain.startswith("no number of ours alone, since the published number is too uncertain; ")


@in_one_test(
    ("text", "path"),
    [
        ("published = 20.0\n", "claim[0].n"),  # a point: only a tolerance of kind "value" is possible
        ("published = 20.0\nsd = 2.0\n", "claim[0].n"),
        ("published = 20.0\nsd = 2.0\nn = 1\n", "claim[0].n"),
        ("published = 20.0\nsd = 2.0\nse = 1.0\nn = 9\n", "claim[0].n"),
        ("published = 20.0\nn = 9\n", "claim[0].n"),
        ("sd = 2.0\nn = 9\n", "claim[0].published"),
        ("published = 20.0\nsd = 2.0\nn = 9\nwithin = [21.0, 30.0]\n", "claim[0].within"),
        ("published = 20.0\nsd = 2.0\nn = 9\nwithin = [10.0]\n", "claim[0].within"),
        ("published = 20.0\nsd = 2.0\nn = 9\nabove = 3.0\n", "claim[0].above"),
        ("published = 20.0\nsd = 2.0\nn = 9\nwithin = [19.0, 21.0]\n", "claim[0].within"),  # its own error is 1.5
        ('published = 20.0\nsd = 2.0\nn = 9\nexpect = "agrees"\n', "claim[0].expect"),  # without a margin it cannot
    ],
)
def test_what_cannot_be_compared_is_refused(text: str, path: str) -> None:
    with pytest.raises(SettingsError) as refused:
        made(OWN + PUBLISHED + text)
    assert [problem.path for problem in refused.value.problems] == [path]


def test_a_run_takes_the_wall_time_of_all_divided_by_their_number() -> None:
    """88.8 minutes for 560 runs are 9.51 s each; what a page of before does not tell is not known."""
    told = {"runs": "560 of 560, by in-process", "wall time of all sessions": "88.8 min"}
    assert run_s(pd.DataFrame({"what": told.keys(), "value": told.values()})) == pytest.approx(9.514, abs=0.001)
    assert run_s(pd.DataFrame({"what": ["runs"], "value": ["560 of 560"]})) is None


def test_a_number_that_differs_against_expectation_is_a_surprise() -> None:
    for expect, is_surprise in (("holds", True), ("undecided", True), ("differs", False), ("refuted", False)):
        study = made(OWN + PUBLISHED + f'published = 5.0\nsd = 1.0\nn = 9\nexpect = "{expect}"\n')
        runs = runs_with(study, lambda _level, _mode, replicate: VALUES[replicate])
        evidence = Evidence(study, runs, pd.DataFrame(), pd.DataFrame())
        assert evidence.surprises == ["p: Waiting"] * is_surprise
        judged = Record(protocol_of(study, Path(__file__).parent), evidence).surprises
        assert judged["is_surprise"].tolist() == [is_surprise]


def test_without_data_there_is_no_test() -> None:
    order = '[[claim]]\nid = "{}"\ntext = "t"\nsource = "{}"\nmetric = "waiting_all"\nless = "{}"\nmore = "{}"\n'
    study = made(OWN + order.format("a", "x", SAME, SLOW) + order.format("b", "y", SAME, FAST))
    runs = runs_with(study, lambda _level, _mode, replicate: VALUES[replicate])
    evidence = Evidence(study, runs[runs["variant"] != SLOW], pd.DataFrame(), pd.DataFrame())
    assert counted(evidence.tables) == {"tests": 1, "families": 1}
    assert evidence.claims["about"].tolist() == [f"{SLOW} over {SAME}", f"{FAST} over {SAME}"]


def test_a_fits_leave_one_out_by_hand() -> None:
    """One number alone keeps "b" from being the closest: 0.5 + 0.5 against 4 + 0.1, and 0.5 against 0.1 without it."""
    distances = {"a": {"m": 0.5, "n": 0.5}, "b": {"m": 4.0, "n": 0.1}}
    rows = [
        {"within": within, "target": target, "without": sum(own.values()) - own[target]}
        for within, own in distances.items()
        for target in own
    ]
    shown = leave_one_out(pd.DataFrame(rows), "Fit")
    assert shown.title == "Fit: sums of squares without one number; 1 of 2 leave the same combination closest"
    assert shown.headings == ["Combination", "without m", "without n"]
    assert shown.rows == [("a", "0.50", "0.50 (closest)"), ("b", "0.10 (closest)", "4.00")]


def test_a_single_replicate_decides_nothing() -> None:
    """It has no spread: no interval, p 1, and no number that would decide can be told."""
    study = made(OWN + PUBLISHED + "published = 20.0\nsd = 2.0\nn = 9\n")
    runs = runs_with(study, lambda _level, _mode, replicate: VALUES[replicate])
    row: Any = claims_of(study, runs[runs["replicate"] == 0]).iloc[0]
    assert (row["verdict"], row["n"], row["p"], row["low"]) == ("undecided", 1, 1.0, None)
    none = claims_of(study, runs[:0]).iloc[0]
    assert (none["verdict"], none["n"]) == ("no data", 0)
