"""Sensitivity studies: in which share of a space a claim holds, and which keys turn it, from tables made up for it."""

import math

import pandas as pd
import pytest

from deltaswarm_orchestrator.sweeps.sensitivity import RangeSettings
from deltaswarm_studies.claim_settings import ClaimSettings
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.sensitivity import (
    MOVES,
    NEITHER,
    TURNS,
    Feature,
    at_points,
    correlations,
    features_of,
    rank_correlation,
    sensitivity_of,
    share_interval,
    smallest_correlation,
    with_verdicts,
)
from tests.support.drawn_studies import found, noise, rate
from tests.support.studying import made


def verdicts(evidence: Evidence) -> dict[str, str]:
    assert evidence.sensitivity
    return dict(zip(evidence.sensitivity.keys["title"], evidence.sensitivity.keys["verdict"], strict=True))


def test_the_key_that_turns_a_claim_is_found() -> None:
    """Where events are rare trees report more, where they are frequent less; noise hides it at single points."""
    _, evidence = found(lambda values, number: math.exp(2 * rate(values) - 1) * noise(number))
    assert verdicts(evidence) == {
        "Event rate [1/s]": TURNS,
        "Radio range [m]": NEITHER,
        "Recruitment: off": NEITHER,
        "A member works on: all": NEITHER,
    }
    assert evidence.sensitivity
    [share] = evidence.sensitivity.shares.to_dict("records")
    assert share["n"] == 60
    assert 0.4 < share["share"] < 0.6
    row = evidence.sensitivity.keys.iloc[0]
    assert row["rho"] > 0.8
    assert row["share_low"] < 0.1
    assert row["share_high"] > 0.9
    assert evidence.sensitivity.strongest("quiet")[0].key == "events.rate_hz"


def test_a_choice_that_turns_a_claim_is_found() -> None:
    _, evidence = found(lambda values, number: (1.5 if values["control.recruitment"] == "on" else 0.6) * noise(number))
    assert verdicts(evidence)["Recruitment: off"] == TURNS
    assert evidence.sensitivity
    row = evidence.sensitivity.keys.set_index("title").loc["Recruitment: off"]
    assert row["rho"] < -0.7
    assert row["share_low"] > 0.8 > 0.2 > row["share_high"]


def test_a_key_that_only_changes_the_size_turns_nothing() -> None:
    """With more events trees report less by more, and they report less everywhere."""
    _, evidence = found(lambda values, number: 1.5 + rate(values) + 0.1 * math.log(noise(number)))
    assert verdicts(evidence)["Event rate [1/s]"] == MOVES
    assert evidence.sensitivity
    assert evidence.sensitivity.shares["share"].tolist() == [1.0]
    assert evidence.sensitivity.keys["p_holds"].isna().all()


def test_where_nothing_turns_a_claim_nothing_is_found() -> None:
    _, evidence = found(lambda values, number: noise(number))
    assert set(verdicts(evidence).values()) == {NEITHER}


def runs(**values: list[float | None]) -> pd.DataFrame:
    rows = [
        {"variant": name, "replicate": point, "messages": value}
        for name, column in values.items()
        for point, value in enumerate(column)
    ]
    return pd.DataFrame(rows)


def test_an_order_is_judged_at_each_point() -> None:
    """3 over 2 holds, 2 over 3 does not, nor does a tie but for rounding; and a run that is missing says nothing."""
    claim = ClaimSettings("c", "less", metric="messages", less="a", more="b")
    judged = at_points(claim, runs(a=[2.0, 3.0, 0.3, 1.0, None], b=[3.0, 2.0, 0.1 + 0.2, None, 1.0]), 6)
    assert judged.holds.tolist()[:3] == [1, 0, 0]
    assert judged.is_tie.tolist()[:3] == [0, 0, 1]
    assert judged.effect.tolist()[:3] == pytest.approx([1.5, 2 / 3, 1.0])
    assert judged.holds[3:].isna().all()
    assert judged.effect[3:].isna().all()
    large = at_points(claim, runs(a=[1e6, 0.0], b=[1e6 + 1e-4, 0.0]), 2)
    assert large.is_tie.tolist() == [1, 1]
    assert large.holds.tolist() == [0, 0]
    twice = ClaimSettings("c", "less", metric="messages", less="a", more="b", at_least=2.0)
    assert at_points(twice, runs(a=[1.0, 1.0, 1.0], b=[1.9, 2.0, 2.1]), 3).holds.tolist() == [0, 0, 1]


def test_without_a_ratio_an_order_is_a_difference() -> None:
    claim = ClaimSettings("c", "less", metric="messages", less="a", more="b", at_least=2.0)
    judged = at_points(claim, runs(a=[0.0, 1.0, 2.0], b=[1.0, 2.5, 3.0]), 3)
    assert judged.effect.tolist() == [1.0, 0.5, -1.0]
    assert not judged.is_ratio
    assert judged.holds.tolist() == [1, 1, 0]


def test_values_and_likeness_are_judged_at_each_point() -> None:
    """Within the tolerance, ends included; within the margin, in either direction, also of zeros."""
    value = ClaimSettings("c", "value", kind="value", metric="messages", of="a", within=(2.0, 3.0))
    assert at_points(value, runs(a=[1.9, 2.0, 3.0, 3.1]), 4).holds.tolist() == [0, 1, 1, 0]
    above = ClaimSettings("c", "value", kind="value", metric="messages", of="a", above=2.0)
    assert at_points(above, runs(a=[1.9, 2.1]), 2).holds.tolist() == [0, 1]
    alike = ClaimSettings("c", "alike", kind="alike", metric="messages", a="a", b="b", margin=1.25)
    judged = at_points(alike, runs(a=[4.0, 5.0, 5.1, 4.0], b=[5.0, 4.0, 4.0, 5.1]), 4)
    assert judged.holds.tolist() == [1, 1, 0, 0]
    assert judged.effect.tolist() == pytest.approx([0.8, 1.25, 1.275, 4 / 5.1])
    judged = at_points(alike, runs(a=[0.0, 0.0], b=[0.0, 1.0]), 2)
    assert judged.holds.tolist() == [1, 0]
    assert judged.effect.tolist() == [0, -1]
    assert judged.is_tie.tolist() == [0, 0]


def test_choices_without_an_order_are_taken_one_by_one() -> None:
    """Of two the second, of three each; numbers have an order, and whole tables none. Missing stays missing."""
    two = RangeSettings("k", "Idle root", choices={"stays": "s", "leaves": "l"})
    [feature] = features_of(two, pd.Series(["stays", "leaves", None, "of an older file"]))
    assert feature.title == "Idle root: leaves"
    assert feature.values.tolist()[:2] == [0, 1]
    assert feature.values[2:].isna().all()
    three = RangeSettings("k", "Events", choices={"50 I": [[50, 0], [0, 50]], "any": "x", "none": False})
    features = features_of(three, pd.Series(["50 I", "any", "none"]))
    assert [one.values.tolist() for one in features] == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    mixed = features_of(RangeSettings("k", "Delta", choices={"two": 2, "chosen": "x"}), pd.Series(["two", "chosen"]))
    assert [(one.title, one.values.tolist()) for one in mixed] == [("Delta: chosen", [0, 1])]
    [number] = features_of(RangeSettings("k", "Delta", choices={"two": 2, "ten": 10}), pd.Series(["two", "ten"]))
    assert number.is_number
    assert number.values.tolist() == [2, 10]


def test_shares_have_exact_intervals() -> None:
    """By Clopper and Pearson; of 20 in 20 the lower end is the twentieth root of 0.025."""
    assert share_interval(8, 10) == pytest.approx((0.4439, 0.9748), abs=1e-4)
    assert share_interval(20, 20) == pytest.approx((0.025 ** (1 / 20), 1.0))
    assert all(map(math.isnan, share_interval(0, 0)))


def test_rank_correlations_need_points_that_vary() -> None:
    """Spearman: 1 for any rising function; of 10 points with ranks 2 and 1 exchanged, 1 - 6 x 2 / 990."""
    line = pd.Series(range(10))
    assert rank_correlation(line, line**3)[0] == pytest.approx(1.0)
    swapped = pd.Series([1, 0, *range(2, 10)])
    assert rank_correlation(line, swapped)[0] == pytest.approx(1 - 12 / 990)
    for a, b in ((line[:9], line[:9]), (line, line * 0)):
        assert all(map(math.isnan, rank_correlation(a, b)))


def test_all_correlations_are_corrected_together() -> None:
    """Holm over the four that are known: 0.01 x 4, 0.012 x 3 raised to it, 0.03 x 2, 0.5."""
    keys = pd.DataFrame({"p": [0.01, 0.03, 0.5], "p_holds": [0.012, math.nan, math.nan]})
    corrected = with_verdicts(keys)
    assert corrected["p_holm"].tolist() == pytest.approx([0.04, 0.06, 0.5])
    assert corrected["p_holds_holm"].tolist()[0] == pytest.approx(0.04)
    assert corrected["verdict"].tolist() == [TURNS, NEITHER, NEITHER]


def test_a_key_turns_a_claim_only_after_the_correction() -> None:
    """0.03 among four tests is 0.12, and 0.012 is 0.048."""
    keys = pd.DataFrame({"p": [0.9, 0.9], "p_holds": [0.03, 0.012]})
    assert with_verdicts(keys)["verdict"].tolist() == [NEITHER, TURNS]


def test_a_p_value_at_the_level_is_shown() -> None:
    assert with_verdicts(pd.DataFrame({"p": [0.05], "p_holds": [math.nan]}))["verdict"].tolist() == [MOVES]
    assert with_verdicts(pd.DataFrame({"p": [math.nan], "p_holds": [0.05]}))["verdict"].tolist() == [TURNS]


def test_a_third_of_the_points_is_low_and_a_third_high() -> None:
    """Of ten evenly spaced values the least four and the greatest four; the claim holds at 1, 4, 7, 8, 9 and 10."""
    values, holds = pd.Series(range(1, 11)), pd.Series([1.0, 0, 0, 1, 0, 0, 1, 1, 1, 1])
    row = correlations(ClaimSettings("c", "less"), Feature("k", "Key", values, True), values * 1.0, holds)
    assert (row["share_low"], row["share_high"]) == (0.5, 1.0)


def test_tables_of_an_earlier_drawing_and_sweeps_without_points_have_no_shares() -> None:
    study, evidence = found(lambda values, number: 2.0)
    assert sensitivity_of(study, evidence.runs.drop(columns="radio.range_m")) is None
    assert sensitivity_of(made(), evidence.runs) is None


def test_the_least_correlation_that_points_would_show() -> None:
    """103 points, one test: (1.960 + 0.842) sqrt(1.06 / 100) = 0.2884; of ten tests 2.807 instead of 1.960."""
    assert smallest_correlation(103, 1) == pytest.approx(math.tanh(0.28844), abs=1e-4)
    assert smallest_correlation(103, 10) == pytest.approx(math.tanh((2.8070 + 0.8416) * math.sqrt(0.0106)), abs=1e-4)
    assert smallest_correlation(4, 1) > 0.99
    assert smallest_correlation(3, 1) == 1.0
