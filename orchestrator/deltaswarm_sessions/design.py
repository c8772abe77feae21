"""Who does which condition at which place, with which stream of arrivals. Pure.

Orders are rows of a Williams design, a Latin square balanced for carry-over effects: over the rows, each condition
occurs equally often at each place, and equally often directly after each other condition (Williams 1949). Streams are
crossed with it: over two passes through the rows, each stream occurs equally often with each condition and at each
place, so that the effects of stream, place and condition can be told apart.
"""

from random import Random
from typing import NamedTuple


class Placed(NamedTuple):
    """A condition and a stream of arrivals, by number from 0."""

    condition: int
    stream: int


def square(count: int) -> list[list[int]]:
    """Return the rows of a Williams design of `count` conditions: `count` rows if that is even, else twice as many."""
    first = [0, *(place // 2 + 1 if place % 2 == 0 else count - place // 2 - 1 for place in range(count - 1))]
    rows = [[(condition + shift) % count for condition in first] for shift in range(count)]
    return rows if count % 2 == 0 else rows + [row[::-1] for row in rows]


def group_of(count: int, *, is_crossed: bool) -> int:
    """Return how many participants do every order of `count` conditions equally often; with crossed streams, these too.

    Recruit participants in multiples of it.
    """
    return len(square(count)) * (2 if is_crossed else 1)


def order_of(participant: int, count: int, seed: int | None = None) -> list[Placed]:
    """Return what a participant (1, 2, ...) does, in order.

    Each pass through the rows is in an order drawn from `seed`; without a seed, participants take the rows in turn.
    """
    rows = square(count)
    cycle, place = divmod(participant - 1, len(rows))
    numbers = list(range(len(rows)))
    if seed is not None:
        Random(f"deltaswarm/{seed}/allocation/{cycle}").shuffle(numbers)
    row = numbers[place]
    return [Placed(condition, (condition + row + cycle) % count) for condition in rows[row]]
