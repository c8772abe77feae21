"""Active Recruitment (the paper's section of that name).

Once a minute a root picks the leaf of its tree that senses the fewest events, and sends it where most known events are:
to a place within range of at least one other member and at least d_min from all. Only leaves are moved, so no branch
breaks. The order travels down the tree; the leaf does no work on its way and takes a parent on arrival. The paper does
not say what holds when no such place senses an event: see `recruitment_places`.
"""

import math
from collections.abc import Iterable, Sequence
from functools import cache
from random import Random

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.beliefs import to_cm
from deltaswarm_agent.controllers.paper.frames import Descendant, Member, RecruitmentOrder
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.settings import ANY
from deltaswarm_agent.controllers.paper.states import Cause
from deltaswarm_agent.controllers.paper.timers import steps_of
from deltaswarm_agent.controllers.paper.whereabouts import RANGE_MARGIN_M
from deltaswarm_wire.messages import Event, Pose

MAX_TRIES = 1000
"""Places drawn at random in the search for a legal one."""


def recruit(agent: Agent, membership: Membership, carried: RecruitmentOrder | None) -> None:
    """Let a root give an order when due, and repeat the last one (`carried`) until it expires."""
    every = steps_of(agent.settings.recruitment_interval_s, agent.shared.step_s)
    if agent.settings.recruitment and membership.pulse and membership.pulse % every == 0:
        agent.order = new_order(agent, membership.table())
    else:
        agent.order = passed_on(carried)


def passed_on(order: RecruitmentOrder | None) -> RecruitmentOrder | None:
    """Return an order after one more hop; None once it has expired."""
    return order._replace(ttl=order.ttl - 1) if order is not None and order.ttl > 1 else None


def new_order(agent: Agent, table: Sequence[Descendant]) -> RecruitmentOrder | None:
    """Send the weakest leaf where most known events are; None without a leaf or such a place.

    The order's number is the step, which does not restart with a root.
    """
    leaf = weakest_leaf(table, agent.rng)
    if leaf is None:
        return None
    shared = agent.shared
    in_transit = {recruit: held for recruit, held in agent.recruits_in_transit.items() if held[1] > agent.now}
    agent.recruits_in_transit = in_transit
    here = (leaf.x_cm * 0.01, leaf.y_cm * 0.01)
    others = [(agent.here.x_m, agent.here.y_m)]
    others += [(row.x_cm * 0.01, row.y_cm * 0.01) for row in table if row.agent != leaf.agent]
    legal = Legal(
        others,
        [held[0] for mover, held in agent.recruits_in_transit.items() if mover != leaf.agent],
        range_m=shared.range_m - RANGE_MARGIN_M,
        d_min_m=agent.settings.d_min_m,
        size_m=(shared.width_m, shared.height_m),
        margin_m=shared.radius_m,
    )
    place = best_place(here, legal, agent.beliefs.active(), shared.sensing_range_m)
    if place is None and agent.settings.recruitment_places == ANY:
        place = legal.draw(agent.rng)
    if place is None:
        return None
    travel_s = math.dist(here, place) / shared.speed_mps
    timers = agent.timers
    arrives = agent.now + timers.order + steps_of(travel_s, shared.step_s) + timers.arrival
    agent.recruits_in_transit[leaf.agent] = (place, arrives)
    return RecruitmentOrder(leaf.agent, to_cm(place[0]), to_cm(place[1]), agent.now, timers.order)


def hear_order(agent: Agent, membership: Membership, parent: Member) -> bool:
    """Carry out the parent's order, or pass it on to the branch that has its leaf; True if this agent goes."""
    order = parent.order
    if order is None:
        return False
    if order.leaf != agent.id:
        if order.ttl > 1 and membership.has_below(order.leaf):
            agent.order = passed_on(order)
        return False
    place = (order.x_cm / 100, order.y_cm / 100)
    if membership.children or order.number == agent.followed_order or not agent.here.is_reachable(*place):
        return False
    agent.followed_order = order.number
    agent.recruit_goal = place
    agent.since = agent.now + 1
    agent.change(Cause.ORDERED)
    return True


def has_arrived(agent: Agent) -> bool:
    """Whether a recruited agent is at its place; until it is, its search for a parent has not begun."""
    if agent.here.is_at(*agent.recruit_goal):
        return True
    agent.since = agent.now + 1
    return False


def weakest_leaf(table: Sequence[Descendant], rng: Random) -> Descendant | None:
    """The leaf that senses the fewest events, ties at random; None in a tree without leaves."""
    parents = {row.parent for row in table}
    leaves = [row for row in table if row.agent not in parents]
    if not leaves:
        return None
    least = min(row.score for row in leaves)
    return rng.choice(sorted(row for row in leaves if row.score == least))


class Legal:
    """Where a leaf may be sent: on a 1 m grid in the arena, `margin_m` from its edge.

    A place is within `range_m` of some member of the tree but the leaf, and at least `d_min_m` from each of them and
    from the places taken, to which agents are under way.
    """

    def __init__(
        self,
        members: Sequence[Pose],
        taken: Sequence[Pose],
        *,
        range_m: float,
        d_min_m: float,
        size_m: Pose,
        margin_m: float = 0.0,
    ) -> None:
        self._members, self._taken = members, taken
        self._range_m = range_m
        self._near_m2, self._far_m2 = d_min_m**2, range_m**2
        self._size_m, self._margin_m = size_m, margin_m

    def __contains__(self, cell: tuple[int, int]) -> bool:
        (x, y), margin_m = cell, self._margin_m
        if not (margin_m <= x <= self._size_m[0] - margin_m and margin_m <= y <= self._size_m[1] - margin_m):
            return False
        within = False
        for x_m, y_m in self._members:
            distance_m2 = (x - x_m) ** 2 + (y - y_m) ** 2
            if distance_m2 < self._near_m2:
                return False
            within = within or distance_m2 <= self._far_m2
        return within and all((x - x_m) ** 2 + (y - y_m) ** 2 >= self._near_m2 for x_m, y_m in self._taken)

    def draw(self, rng: Random) -> Pose | None:
        """Draw one of the legal places, each with the same probability; None if none is found."""
        reach_m, members = self._range_m, self._members
        for _ in range(MAX_TRIES):
            x_m, y_m = rng.choice(members)
            x = round(rng.uniform(x_m - reach_m, x_m + reach_m))
            y = round(rng.uniform(y_m - reach_m, y_m + reach_m))
            if (x, y) in self:
                near = sum(abs(x - x_m) <= reach_m and abs(y - y_m) <= reach_m for x_m, y_m in members)
                if near * rng.random() < 1.0:  # places near several members are proposed as often
                    return float(x), float(y)
        return None


def best_place(leaf: Pose, legal: Legal, events: Iterable[Event], sensing_range_m: float) -> Pose | None:
    """The legal place from which most known events are sensed [m].

    Among equals the nearest to the leaf; None if no legal place senses an event.
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
    by_score: dict[int, list[tuple[int, int]]] = {}
    for cell, score in scores.items():
        by_score.setdefault(score, []).append(cell)
    for score in sorted(by_score, reverse=True):
        places = [cell for cell in by_score[score] if cell in legal]
        if places:
            x, y = min(places, key=lambda cell: ((cell[0] - leaf[0]) ** 2 + (cell[1] - leaf[1]) ** 2, cell))
            return float(x), float(y)
    return None


@cache
def _cells_within(reach: int) -> tuple[tuple[int, int], ...]:
    """Cells around the origin that can be within `reach` (and half a cell) of it."""
    cells = range(-reach - 1, reach + 2)
    return tuple((i, j) for i in cells for j in cells if i * i + j * j <= (reach + 1) ** 2)
