"""The order of conditions is balanced, and streams of arrivals are crossed with it."""

from collections import Counter
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_sessions.plan import Placed, order_of, square

counts = st.integers(1, 12)
seeds = st.none() | st.integers(0, 2**40)


@given(counts)
def test_each_row_has_every_condition_once(count: int) -> None:
    """Whoever takes part does each once."""
    rows = square(count)
    assert len(rows) == (count if count % 2 == 0 else 2 * count)
    assert all(sorted(row) == list(range(count)) for row in rows)


@given(counts)
def test_places_and_successions_are_balanced(count: int) -> None:
    """Each condition comes equally often at each place, and equally often right after each other one."""
    rows = square(count)
    places = Counter((place, condition) for row in rows for place, condition in enumerate(row))
    assert set(places.values()) == {len(rows) // count}
    pairs = Counter(pair for row in rows for pair in pairwise(row))
    assert len(pairs) == count * (count - 1)
    assert set(pairs.values()) <= {1 if count % 2 == 0 else 2}


@given(st.integers(0, 40), counts, seeds)
def test_each_pass_takes_every_row_once(cycle: int, count: int, seed: int | None) -> None:
    """In turn, or in an order drawn from the seed; the same participant has always the same."""
    rows = square(count)
    first = cycle * len(rows) + 1
    orders = [order_of(participant, count, seed) for participant in range(first, first + len(rows))]
    conditions = [[condition for condition, _ in order] for order in orders]
    assert sorted(conditions) == sorted(rows)
    assert orders[0] == order_of(first, count, seed)
    if seed is None:
        assert conditions == rows


@given(st.integers(2, 8), st.integers(6, 48), seeds)
def test_streams_conditions_and_places_are_balanced(count: int, participants: int, seed: int | None) -> None:
    """Any two of the three: equally often after two passes, and never far from it; nobody meets a stream twice."""
    done = [order_of(participant, count, seed) for participant in range(1, participants + 1)]
    assert all(sorted(stream for _, stream in order) == list(range(count)) for order in done)
    cells: list[Counter[tuple[int, int]]] = [Counter(), Counter(), Counter()]
    for order in done:
        for place, (condition, stream) in enumerate(order):
            for counter, pair in zip(cells, ((condition, stream), (place, stream), (place, condition)), strict=True):
                counter[pair] += 1
    rows = len(square(count))
    for counter in cells:
        times = [counter[first, second] for first in range(count) for second in range(count)]
        if participants % (2 * rows) == 0:
            assert len(set(times)) == 1
        assert max(times) - min(times) <= 2 * rows // count


def test_rows_differ_between_seeds() -> None:
    """Nobody can tell from a participant's number what comes next."""
    firsts = {tuple(order_of(1, 4, seed)) for seed in range(40)}
    assert len(firsts) == 4
    assert order_of(1, 2) == [Placed(0, 0), Placed(1, 1)]
