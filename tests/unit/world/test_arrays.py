"""Neighbours: the same pairs whether each is compared or a strip of the arena is searched."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_world.core import arrays as module
from deltaswarm_world.core.arrays import FEW_PAIRS, Floats, near

RANGE_M = 5.0
on_a_grid = st.integers(0, 40).map(lambda number: number / 2)
places = st.lists(st.tuples(on_a_grid, on_a_grid), max_size=12).map(lambda rows: np.array(rows).reshape(-1, 2))
"""Places of which many are exactly in range of one another, or the same."""


def by_hand(some: Floats, others: Floats) -> list[tuple[int, int]]:
    return [
        (i, j)
        for i, (x, y) in enumerate(some.tolist())
        for j, (u, v) in enumerate(others.tolist())
        if (x - u) * (x - u) + (y - v) * (y - v) <= RANGE_M**2
    ]


def pairs(some: Floats, others: Floats) -> list[tuple[int, int]]:
    first, second = near(some, others, RANGE_M)
    return list(zip(first.tolist(), second.tolist(), strict=True))


@pytest.mark.parametrize("few_pairs", [FEW_PAIRS, -1], ids=["each", "strips"])
@given(some=places, others=places)
def test_all_pairs_in_range_are_found_in_order(few_pairs: int, some: Floats, others: Floats) -> None:
    """The range included; by index of the one, then of the other; both ways of searching."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "FEW_PAIRS", few_pairs)
        assert pairs(some, others) == by_hand(some, others)


def test_a_large_swarm_is_no_other_than_a_small_one() -> None:
    """Beyond the number of pairs from which on strips are searched: bit by bit the same answer."""
    rng = np.random.default_rng(1)
    some, others = rng.random((300, 2)) * 100, rng.random((150, 2)) * 100
    assert len(some) * len(others) > FEW_PAIRS
    assert pairs(some, others) == by_hand(some, others) != []
