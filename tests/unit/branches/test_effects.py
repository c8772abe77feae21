"""The effect of a change: decided by pairs, corrected for the number of comparisons; nothing only if exactly so."""

from deltaswarm_branches.effects import LESS, MORE, NOTHING, UNDECIDED, effects, replicates_needed
from deltaswarm_branches.pairs import MEASURES, Pair


def pairs_of(*sides: tuple[float | None, float | None], measure: str = "waiting", comparison: int = 0) -> list[Pair]:
    """Pairs that differ in one measure; the first under the run's own randomness."""
    same = dict.fromkeys(MEASURES, 5.0)
    return [
        Pair(comparison, number, same | {measure: first}, same | {measure: second})
        for number, (first, second) in enumerate(sides)
    ]


def test_a_difference_is_decided_where_its_interval_leaves_zero_out() -> None:
    """By the signed-rank test over 12 pairs: all larger, all smaller, both, and none at all."""
    for sign, verdict in ((1, MORE), (-1, LESS)):
        drawn = [(10.0 + sign * n, 10.0) for n in range(1, 13)]
        effect = effects(pairs_of((12.0, 9.0), *drawn))[0]
        assert (effect.with_it, effect.without, effect.value) == (12.0, 9.0, 3.0)
        assert (effect.estimate, effect.replicates, effect.verdict) == (6.5 * sign, 12, verdict)
        assert effect.low is not None
        assert effect.high is not None
        assert min(abs(effect.low), abs(effect.high)) >= 1
    little = [(10.0 + n / 1000, 10.0) for n in range(1, 13)]
    assert effects(pairs_of((12.0, 9.0), *little))[0].verdict == MORE
    mixed = [(10.0 + (-1) ** n * n, 10.0) for n in range(1, 13)]
    rows = effects(pairs_of((12.0, 9.0), *mixed))
    assert [row.verdict for row in rows] == [UNDECIDED, *[NOTHING] * 3]
    assert rows[1][3:9] == (5.0, 5.0, 0.0, 0.0, 0.0, 0.0)


def test_nothing_is_to_the_last_bit() -> None:
    """One replicate that differs by a rounding error is undecided, not nothing; no replicates leave it undecided."""
    drawn = [(10.0, 10.0)] * 11
    assert effects(pairs_of((10.0, 10.0), *drawn, (0.1 + 0.2, 0.3)))[0].verdict == UNDECIDED
    assert effects(pairs_of((12.0, 9.0)))[0][5:] == (3.0, None, None, None, 0, None, UNDECIDED)
    assert effects(pairs_of((9.0, 9.0)))[0].verdict == NOTHING


def test_more_comparisons_need_more_replicates() -> None:
    """Six pairs decide one comparison and none of 40; a pair that lacks a value is left out."""
    drawn = [(10.0 + n, 10.0) for n in range(1, 7)]
    alone = effects(pairs_of((12.0, 9.0), *drawn))
    assert alone[0].verdict == UNDECIDED  # one of four measures
    many = [pair for place in range(10) for pair in pairs_of((12.0, 9.0), *drawn, comparison=place)]
    assert {effect.verdict for effect in effects(many)} == {UNDECIDED, NOTHING}
    assert replicates_needed(4) == 8
    assert replicates_needed(40) > 8
    assert effects(pairs_of((12.0, 9.0), *drawn, (None, 4.0)))[0].replicates == 6
