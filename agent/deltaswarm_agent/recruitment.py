"""Active Recruitment: which leaf a root moves, and to which place."""

import math
from collections.abc import Iterable, Sequence
from functools import cache
from random import Random

from deltaswarm_agent.beliefs import to_cm
from deltaswarm_agent.tree import RANGE_MARGIN_M
from deltaswarm_wire.messages import Event
from deltaswarm_wire.radio import Descendant, Order
from deltaswarm_wire.settings import AgentSettings

ORDER_TTL_STEPS = 12
"""An order is sent, and relayed, for so long."""

BLOCKED_S = 60.0
"""For so long the place of a mover under way counts as taken."""

Place = tuple[float, float]


class Recruiter:
    """A root's orders, and the places that are taken by movers under way."""

    def __init__(self, settings: AgentSettings, rng: Random) -> None:
        self._settings = settings
        self._rng = rng
        self._blocked_steps = round(BLOCKED_S / settings.step_s)
        self._orders_given = 0
        self._movers: dict[int, tuple[Place, int]] = {}

    def forget_movers(self) -> None:
        """They were another tree's."""
        self._movers.clear()

    def order(self, table: Sequence[Descendant], here: Place, events: Iterable[Event], now: int) -> Order | None:
        """The weakest leaf is to go where most known events are; None without a leaf or such a place."""
        leaf = weakest_leaf(table, self._rng)
        if leaf is None:
            return None
        self._movers = {agent: mover for agent, mover in self._movers.items() if mover[1] > now}
        members = [(row.x_cm * 0.01, row.y_cm * 0.01) for row in table if row.agent != leaf.agent]
        members += [place for agent, (place, _) in self._movers.items() if agent != leaf.agent]
        place = best_place(
            (leaf.x_cm * 0.01, leaf.y_cm * 0.01),
            [here, *members],
            events,
            sensing_range_m=self._settings.sensing_range_m,
            range_m=self._settings.range_m - RANGE_MARGIN_M,
            d_min_m=self._settings.control.d_min_m,
            size_m=(self._settings.width_m, self._settings.height_m),
        )
        if place is None:
            return None
        self._orders_given += 1
        self._movers[leaf.agent] = (place, now + self._blocked_steps)
        return Order(leaf.agent, to_cm(place[0]), to_cm(place[1]), self._orders_given, ORDER_TTL_STEPS)


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
