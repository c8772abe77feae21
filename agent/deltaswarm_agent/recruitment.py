"""Active Recruitment: which leaf a root moves, and to which place."""

import math
from collections.abc import Iterable, Sequence
from functools import cache
from random import Random

from deltaswarm_wire.messages import Event
from deltaswarm_wire.radio import Descendant

ORDER_TTL_STEPS = 12
"""An order is sent, and relayed, for so long."""

BLOCKED_S = 60.0
"""For so long the place of a mover under way counts as taken."""

Place = tuple[float, float]


def weakest_leaf(table: Sequence[Descendant], rng: Random) -> Descendant | None:
    """The leaf that senses the fewest events, ties at random; None in a tree without leaves."""
    parents = {row.parent for row in table}
    leaves = [row for row in table if row.agent not in parents]
    if not leaves:
        return None
    least = min(row.score for row in leaves)
    return rng.choice(sorted(row for row in leaves if row.score == least))


def best_place(
    leaf: Place,
    members: Sequence[Place],
    events: Iterable[Event],
    *,
    sensing_range_m: float,
    range_m: float,
    d_min_m: float,
    size_m: Place,
) -> Place | None:
    """The place on a 1 m grid from which most known events are sensed.

    It is within `range_m` of a member and at least `d_min_m` from all of them (`members`: all of the
    tree but the leaf, places in m). Among equals the nearest to the leaf; None if no legal place
    senses an event.
    """
    scores: dict[tuple[int, int], int] = {}
    offsets = _cells_within(math.ceil(sensing_range_m))
    reach_m2 = sensing_range_m**2
    for event in events:
        cx, cy = round(event.x_m), round(event.y_m)
        fx, fy = cx - event.x_m, cy - event.y_m
        for i, j in offsets:
            if (i + fx) ** 2 + (j + fy) ** 2 <= reach_m2:
                cell = (cx + i, cy + j)
                scores[cell] = scores.get(cell, 0) + 1
    near_m2, far_m2 = d_min_m**2, range_m**2
    by_score: dict[int, list[tuple[int, int]]] = {}
    for cell, score in scores.items():
        by_score.setdefault(score, []).append(cell)
    for score in sorted(by_score, reverse=True):
        legal = [
            cell
            for cell in by_score[score]
            if 0 <= cell[0] <= size_m[0] and 0 <= cell[1] <= size_m[1] and _legal(cell, members, near_m2, far_m2)
        ]
        if legal:
            x, y = min(legal, key=lambda cell: ((cell[0] - leaf[0]) ** 2 + (cell[1] - leaf[1]) ** 2, cell))
            return float(x), float(y)
    return None


def _legal(cell: tuple[int, int], members: Sequence[Place], near_m2: float, far_m2: float) -> bool:
    """Within range of a member, and not too close to any."""
    within = False
    for x_m, y_m in members:
        distance_m2 = (cell[0] - x_m) ** 2 + (cell[1] - y_m) ** 2
        if distance_m2 < near_m2:
            return False
        within = within or distance_m2 <= far_m2
    return within


@cache
def _cells_within(reach: int) -> tuple[tuple[int, int], ...]:
    """Cells around the origin that can be within `reach` (and half a cell) of it."""
    cells = range(-reach - 1, reach + 2)
    return tuple((i, j) for i in cells for j in cells if i * i + j * j <= (reach + 1) ** 2)
