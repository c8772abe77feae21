"""Effect of a change: paired differences with confidence intervals, and a verdict. Pure."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from deltaswarm_branches.pairs import BY_KEY, MEASURES, Pair
from deltaswarm_branches.parent import Order
from deltaswarm_studies.stats import DIFFERENCE, contrast, holm, pairs_needed

MORE, LESS, NOTHING, UNDECIDED = "more", "less", "nothing", "undecided"


class Effect(NamedTuple):
    """One measure of one comparison: with the change minus without it."""

    comparison: int
    measure: str
    unit: str
    with_it: float | None
    """With the run's own randomness; None: nothing to measure."""
    without: float | None
    value: float | None
    """Their difference."""
    estimate: float | None
    """Hodges-Lehmann estimate of the difference over the replicates."""
    low: float | None
    """Lower end of its interval, with a confidence of 95 % over all rows (Holm); None: no end."""
    high: float | None
    replicates: int
    """Pairs in which both sides could be measured."""
    p_adjusted: float | None
    verdict: str
    """more, less, undecided, or nothing: no difference in any pair, to the last bit."""


class OrderEffect(NamedTuple):
    """The effect of an order on one measure."""

    order: Order
    effect: Effect


def effects(pairs: Sequence[Pair]) -> list[Effect]:
    """Return the effect of each comparison on each measure; all tests are corrected together."""
    keys = [(place, name) for place in dict.fromkeys(pair.comparison for pair in pairs) for name in MEASURES]
    own = {pair.comparison: pair for pair in pairs if not pair.replicate}
    drawn = {place: [pair for pair in pairs if pair.comparison == place and pair.replicate] for place in own}
    contrasts = [
        contrast(
            [pair.with_it[name] for pair in drawn[place]], [pair.without[name] for pair in drawn[place]], DIFFERENCE
        )
        for place, name in keys
    ]
    tested = holm([found.p() for found in contrasts])
    rows = []
    for (place, name), found, (p_adjusted, alpha) in zip(keys, contrasts, tested, strict=True):
        first, second = own[place].with_it[name], own[place].without[name]
        value = None if first is None or second is None else first - second
        low, high = found.interval(alpha)
        differences = [pair.with_it[name] != pair.without[name] for pair in (own[place], *drawn[place])]
        rows.append(
            Effect(
                place,
                name,
                BY_KEY[MEASURES[name]].unit,
                first,
                second,
                value,
                found.estimate,
                _end(low),
                _end(high),
                found.n,
                p_adjusted if found.n else None,
                _verdict(low, high, is_any=any(differences)),
            )
        )
    return rows


def _end(end: float) -> float | None:
    return None if math.isinf(end) else end


def _verdict(low: float, high: float, *, is_any: bool) -> str:
    if not is_any:
        return NOTHING
    return MORE if low > 0 else LESS if high < 0 else UNDECIDED


def replicates_needed(comparisons: int) -> int:
    """Return how many replicates the smallest difference needs to be decided, among so many comparisons."""
    return pairs_needed(comparisons)
