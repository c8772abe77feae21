"""Claims: what holds, what does not, what is undecided, and that the worst comes first."""

import pytest

from deltaswarm_orchestrator.analysis.claims import (
    Claim,
    EquivalenceClaim,
    OrderClaim,
    ValueClaim,
    Verdict,
    claims_table,
    counted,
    judge,
)

LOW = [20.0, 21.5, 22.0, 23.5, 24.0, 25.5, 26.0, 27.5, 28.0, 29.5]
HIGH = [value + 10 + index / 7 for index, value in enumerate(LOW)]
NEAR = [value + (0.3 if index % 2 else -0.2) + index / 100 for index, value in enumerate(LOW)]


def value(
    name: str = "value", paper: float = 25.0, within: tuple[float, float] = (20, 30), **more: object
) -> ValueClaim:
    return ValueClaim(name, "Section 1", paper, "s", more.get("ours", LOW), within)  # type: ignore[arg-type]


def order(name: str = "order", smaller: list[float] = LOW, larger: list[float] = HIGH, **more: float) -> OrderClaim:
    return OrderClaim(name, "Section 2", "the one is smaller", smaller, larger, paired=True, **more)


def alike(name: str = "alike", b: list[float] = NEAR, margin: float = 2.0) -> EquivalenceClaim:
    return EquivalenceClaim(name, "Section 3", "they are alike", LOW, b, margin, "s", paired=True)


def verdict(claim: Claim) -> Verdict:
    (judgement,) = judge([claim])
    return judgement.verdict


def test_a_value_holds_within_its_tolerance() -> None:
    """Our median is 24.75: what counts is the tolerance, not whether the paper's value is in our interval."""
    assert verdict(value()) == "holds"
    assert verdict(value(within=(24.75, 30))) == "holds"
    assert verdict(value(within=(25, 30))) == "does not hold"


def test_whether_the_papers_value_lies_in_our_interval_is_said_apart() -> None:
    """Both ways, with the same verdict."""
    (inside,), (outside,) = judge([value(paper=25.0)]), judge([value(paper=29.5)])
    assert (inside.in_interval, outside.in_interval) == (True, False)
    assert inside.verdict == outside.verdict == "holds"
    assert inside.paper == "25.0 s"
    assert inside.ours.startswith("24.8 [")
    assert inside.ours.endswith("] s")


def test_an_order_holds_when_the_test_shows_it() -> None:
    """By 10 pairs that all point one way, one-sided: p = 1 in 1,024."""
    (found,) = judge([order()])
    assert found.verdict == "holds"
    assert found.p == pytest.approx(1 / 1024)
    assert found.effect == 1
    assert found.estimate == pytest.approx(found.claim.larger[5] / 25, rel=0.1)  # type: ignore[union-attr,index]


def test_an_order_the_wrong_way_round_does_not_hold() -> None:
    """Whether that can be shown or not."""
    assert verdict(order(smaller=HIGH, larger=LOW)) == "does not hold"
    assert verdict(order(smaller=NEAR, larger=[v - 0.01 for v in NEAR])) == "does not hold"
    assert verdict(order(smaller=LOW, larger=LOW)) == "does not hold"


def test_an_order_in_the_right_direction_without_significance_is_undecided() -> None:
    """Three pairs cannot give a p below 0.125."""
    (found,) = judge([order(smaller=LOW[:3], larger=HIGH[:3])])
    assert (found.verdict, found.p) == ("undecided", 0.125)


def test_a_ratio_that_is_claimed_is_tested_too() -> None:
    """Our ratio is about 1.4: at least 1.2 holds, 1.6 does not; of 1.4 we cannot be sure."""
    assert verdict(order(at_least_ratio=1.2)) == "holds"
    assert verdict(order(at_least_ratio=1.6)) == "does not hold"
    (found,) = judge([order(at_least_ratio=1.41)])
    assert found.verdict != "holds"
    with pytest.raises(ValueError, match="ratio"):
        order(at_least_ratio=0.0)


def test_p_and_effect_size_answer_one_question() -> None:
    """That of a ratio claimed: larger in each pair, but about as often below 1.41 times as above. Else it is said."""
    (plain,) = judge([order()])
    (ratio,) = judge([order(at_least_ratio=1.41)])
    assert plain.effect == 1
    assert ratio.effect is not None
    assert abs(ratio.effect) < 0.8
    assert "one-sided, n = 10 pairs" in plain.why
    assert "one-sided (at least 1.41 times), n = 10 pairs" in ratio.why
    (same,) = judge([alike(b=[v + 0.01 for v in LOW])])
    assert same.verdict == "holds"
    assert same.why.endswith("matched-pairs rank-biserial of any difference -1.00")


def test_ratio_and_shift_must_agree() -> None:
    """In most pairs the second is larger, but its median is smaller: a ratio below 1 beside "holds" would puzzle."""
    (found,) = judge([order(smaller=[1.0, 2.0, 10.0, 11.0, 12.0], larger=[9.0, 9.5, 9.6, 15.0, 16.0])])
    assert found.estimate == pytest.approx(0.96)
    assert found.verdict == "does not hold"


def test_an_order_against_zeros_needs_no_ratio() -> None:
    """Decentralised swarms have no agent in a tree."""
    (found,) = judge([order(smaller=[0.0] * 10)])
    assert found.verdict == "holds"
    assert "times" not in found.ours


def test_equivalence_needs_to_be_shown() -> None:
    """Within 2 s it is; within 0.1 s our estimate says so too but not for sure; 10 s apart is not alike."""
    assert verdict(alike()) == "holds"
    assert verdict(alike(margin=0.1)) == "undecided"
    assert verdict(alike(b=HIGH)) == "does not hold"


def test_one_run_decides_nothing() -> None:
    """Neither for a claim nor against it."""
    assert verdict(value(ours=[25.0])) == verdict(value(ours=[99.0])) == verdict(value(ours=[])) == "undecided"
    assert verdict(order(smaller=[2.0], larger=[1.0])) == "undecided"
    assert verdict(EquivalenceClaim("n", "s", "t", [], [], 1.0, "s", paired=False)) == "undecided"


def test_the_p_values_of_a_report_are_corrected_together() -> None:
    """Five pairs give p = 1/32: alone the claim holds, among others it does not; values are in no family."""
    claim = order(smaller=LOW[:5], larger=HIGH[:5])
    assert verdict(claim) == "holds"
    judged = judge([claim, value(), claim])
    assert [found.p_holm for found in judged if found.p is not None] == pytest.approx([2 / 32, 2 / 32])
    assert [found.verdict for found in judged] == ["undecided", "undecided", "holds"]


def test_what_does_not_hold_is_listed_first() -> None:
    """Then the undecided, then what holds; within a verdict in the order given."""
    claims = [
        value("a"),
        order("b", smaller=LOW[:3], larger=HIGH[:3]),
        value("c", within=(1, 2)),
        order("d"),
        order("e", smaller=HIGH, larger=LOW),
    ]
    judged = judge(claims)
    assert [found.claim.name for found in judged] == ["c", "e", "b", "a", "d"]
    assert counted(judged) == {"does not hold": 2, "undecided": 1, "holds": 2}
    table = claims_table(judged)
    assert [row[0] for row in table.rows] == ["c", "e", "b", "a", "d"]
    assert table.marks == ["bad", "bad", "unsure", "good", "good"]


def test_the_table_says_why() -> None:
    """The tolerance, or the test with its p, the family and the effect."""
    by_name = {row[0]: row for row in claims_table(judge([value(within=(1, 2)), order(), alike()])).rows}
    assert by_name["value"][-2:] == ("does not hold", "median of 10 outside 1 to 2 s")
    for part in ("Wilcoxon", "10 pairs", "p = 0.002 (Holm over 2)", "rank-biserial 1.00"):
        assert part in str(by_name["order"][-1])
    assert "differ by less than 2.00 s" in str(by_name["alike"][-1])


def test_claims_that_cannot_be_are_refused() -> None:
    """A tolerance from high to low, pairs of different number."""
    with pytest.raises(ValueError, match="tolerance"):
        value(within=(2, 1))
    with pytest.raises(ValueError, match="one length"):
        judge([order(smaller=[1.0])])


def test_no_claims_are_no_trouble() -> None:
    """An empty list gives an empty table."""
    assert judge([]) == []
    assert claims_table([]).rows == []
