"""Active Recruitment (the paper's section of that name).

Once a minute a root picks the leaf of its tree that senses the fewest events, and sends it where most known events are:
to a place within range of at least one other member and at least d_min from all. Only leaves are moved, so no branch
breaks. The order travels down the tree; the leaf does no work on its way and takes a parent on arrival.
"""

import math
from collections.abc import Iterable, Sequence
from functools import cache
from random import Random

from deltaswarm_agent.controllers.paper.agent import Agent
from deltaswarm_agent.controllers.paper.beliefs import to_cm
from deltaswarm_agent.controllers.paper.frames import Descendant, Member, RecruitmentOrder
from deltaswarm_agent.controllers.paper.membership import Membership
from deltaswarm_agent.controllers.paper.states import Cause
from deltaswarm_agent.controllers.paper.timers import steps_of
from deltaswarm_agent.controllers.paper.whereabouts import RANGE_MARGIN_M
from deltaswarm_wire.messages import Event, Pose


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
    agent.movers = {mover: held for mover, held in agent.movers.items() if held[1] > agent.now}
    place = best_place(
        (leaf.x_cm * 0.01, leaf.y_cm * 0.01),
        [(agent.here.x_m, agent.here.y_m)]
        + [(row.x_cm * 0.01, row.y_cm * 0.01) for row in table if row.agent != leaf.agent],
        [held[0] for mover, held in agent.movers.items() if mover != leaf.agent],
        agent.beliefs.active(),
        sensing_range_m=agent.shared.sensing_range_m,
        range_m=agent.shared.range_m - RANGE_MARGIN_M,
        d_min_m=agent.settings.d_min_m,
        size_m=(agent.shared.width_m, agent.shared.height_m),
    )
    if place is None:
        return None
    agent.movers[leaf.agent] = (place, agent.now + agent.timers.blocked)
    return RecruitmentOrder(leaf.agent, to_cm(place[0]), to_cm(place[1]), agent.now, agent.timers.order)


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
    if membership.children or order.number == agent.followed_order or not agent.here.is_in_arena(*place):
        return False
    agent.followed_order = order.number
    agent.post = place
    agent.since = agent.now + 1
    agent.change(Cause.ORDERED)
    return True


def has_arrived(agent: Agent) -> bool:
    """Whether a recruited agent is at its place; until it is, its search for a parent has not begun."""
    if agent.here.is_at(*agent.post):
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


def best_place(
    leaf: Pose,
    members: Sequence[Pose],
    taken: Sequence[Pose],
    events: Iterable[Event],
    *,
    sensing_range_m: float,
    range_m: float,
    d_min_m: float,
    size_m: Pose,
) -> Pose | None:
    """The place on a 1 m grid from which most known events are sensed.

    It is within `range_m` of a member and at least `d_min_m` from all of them (`members`: all of the tree but the
    leaf) and from the places `taken` by agents under way (all in m). Among equals the nearest to the leaf; None if no
    legal place senses an event.
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
            if 0 <= cell[0] <= size_m[0]
            and 0 <= cell[1] <= size_m[1]
            and _is_legal(cell, members, taken, near_m2, far_m2)
        ]
        if legal:
            x, y = min(legal, key=lambda cell: ((cell[0] - leaf[0]) ** 2 + (cell[1] - leaf[1]) ** 2, cell))
            return float(x), float(y)
    return None


def _is_legal(
    cell: tuple[int, int], members: Sequence[Pose], taken: Sequence[Pose], near_m2: float, far_m2: float
) -> bool:
    """Within range of a member, and not too close to any member or occupied target."""
    within = False
    for x_m, y_m in members:
        distance_m2 = (cell[0] - x_m) ** 2 + (cell[1] - y_m) ** 2
        if distance_m2 < near_m2:
            return False
        within = within or distance_m2 <= far_m2
    return within and all((cell[0] - x_m) ** 2 + (cell[1] - y_m) ** 2 >= near_m2 for x_m, y_m in taken)


@cache
def _cells_within(reach: int) -> tuple[tuple[int, int], ...]:
    """Cells around the origin that can be within `reach` (and half a cell) of it."""
    cells = range(-reach - 1, reach + 2)
    return tuple((i, j) for i in cells for j in cells if i * i + j * j <= (reach + 1) ** 2)
