"""Active recruitment: which leaf, to which place, and how the order gets there."""

import math
import random
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.frames import Descendant, Member, RecruitmentOrder, Sighting
from deltaswarm_agent.controllers.paper.recruitment import Legal, best_place, weakest_leaf
from deltaswarm_wire.messages import Event
from tests.support.cores import ME, STEPS, Lone, Place, StepAnswer, a_root, child, event, relocating

SIZE_M = (30.0, 24.0)
SENSING_M, RANGE_M, D_MIN_M = 5.0, 9.98, 6.0
EPSILON = 1e-9

in_arena = st.tuples(st.floats(0.0, SIZE_M[0]), st.floats(0.0, SIZE_M[1]))
in_cm = st.tuples(st.integers(0, 3000), st.integers(0, 2400)).map(lambda place: (place[0] / 100, place[1] / 100))


def distance(one: Place, other: Place) -> float:
    return math.hypot(one[0] - other[0], one[1] - other[1])


def score(place: Place, events: Iterable[Event], slack_m: float = 0.0) -> int:
    return sum(distance(place, (e.x_m, e.y_m)) <= SENSING_M + slack_m for e in events)


def is_legal(place: Place, members: Iterable[Place], slack_m: float = 0.0) -> bool:
    distances_m = [distance(place, other) for other in members]
    return min(distances_m) <= RANGE_M + slack_m and all(d >= D_MIN_M - slack_m for d in distances_m)


def chosen(leaf: Place, members: list[Place], events: list[Event], taken: Sequence[Place] = ()) -> Place | None:
    legal = Legal(members, taken, range_m=RANGE_M, d_min_m=D_MIN_M, size_m=SIZE_M)
    return best_place(leaf, legal, events, SENSING_M)


@given(in_arena, st.lists(in_arena, min_size=1, max_size=4), st.lists(in_cm | in_arena, max_size=7))
def test_the_best_place_is_legal_and_no_place_of_the_grid_is_better(
    leaf: Place, members: list[Place], spots: list[Place]
) -> None:
    """By brute force over the arena: the most events, then the nearest to the leaf; at least one event."""
    events = [Event(number, *spot) for number, spot in enumerate(spots)]
    place = chosen(leaf, members, events)
    grid = [(float(x), float(y)) for x in range(31) for y in range(25)]
    legal = {spot: score(spot, events, -EPSILON) for spot in grid if is_legal(spot, members, -EPSILON)}
    if place is None:
        assert max(legal.values(), default=0) == 0
        return
    assert place in grid
    assert is_legal(place, members, EPSILON)
    most = score(place, events, EPSILON)
    assert most >= max(1, *legal.values(), 1)
    rivals = [distance(spot, leaf) for spot, found in legal.items() if found == most]
    assert distance(place, leaf) <= min(rivals, default=math.inf) + EPSILON


def test_the_place_may_be_the_leafs_own() -> None:
    """The leaf is no member to keep away from; exactly d_min from the others is legal."""
    assert chosen((14.0, 12.0), [(8.0, 12.0)], [event(1, 14, 12)]) == (14.0, 12.0)


def test_there_is_no_place_without_a_known_event() -> None:
    """A score of at least 1 is needed; events out of the tree's reach are of no use."""
    assert chosen((15.0, 12.0), [(8.0, 12.0)], []) is None
    assert chosen((15.0, 12.0), [(0.0, 0.0)], [event(1, 29, 23)]) is None


rows = st.lists(
    st.builds(Descendant, st.integers(2, 12), st.integers(1, 12), st.just(0), st.just(0), st.integers(0, 3)),
    max_size=10,
    unique_by=lambda row: row.agent,
)


@given(rows, st.randoms(use_true_random=False), st.integers(0, 1000))
def test_the_leaf_has_no_children_and_senses_the_fewest(table: list[Descendant], order: Any, seed: int) -> None:
    """Chance decides among equals, and the order of the table does not."""
    leaf = weakest_leaf(table, random.Random(seed))
    parents = {row.parent for row in table}
    leaves = [row for row in table if row.agent not in parents]
    if leaf is None:
        assert not leaves
        return
    assert leaf in leaves
    assert leaf.score == min(row.score for row in leaves)
    assert weakest_leaf(order.sample(table, len(table)), random.Random(seed)) == leaf


def test_each_of_equal_leaves_has_its_chance() -> None:
    """Uniform, over 900 draws of a fixed seed."""
    table = [Descendant(agent, 1, 0, 0, 1) for agent in (2, 3, 4)] + [Descendant(5, 1, 0, 0, 2)]
    rng = random.Random(5)
    drawn = [leaf.agent for leaf in (weakest_leaf(table, rng) for _ in range(900)) if leaf]
    assert all(250 <= drawn.count(agent) <= 350 for agent in (2, 3, 4))
    assert 5 not in drawn


LEAF = 2
FAR_EVENT = Sighting(9, 6200, 5800, 0)


def leaf_frame(**more: Any) -> Member:
    return child(LEAF, (ME,), (58, 50), events=[FAR_EVENT], **more)


def orders(decisions: Iterable[StepAnswer]) -> list[RecruitmentOrder | None]:
    return [decision.radio.order for decision in decisions if isinstance(decision.radio, Member)]


def with_a_leaf(until: int, **control: Any) -> tuple[Lone, list[RecruitmentOrder | None]]:
    """A root with one leaf up to a step; what it orders in the steps from 1 on."""
    root = a_root(**control)
    return root, orders(root.steps(until, leaf_frame()))


@pytest.mark.parametrize("interval_s", [60, 20])
def test_a_root_recruits_on_its_own_clock(interval_s: int) -> None:
    """Each 60 s of its own pulse, said for 12 steps with less and less time to live; its number is the step."""
    _, said = with_a_leaf(2 * interval_s + 15, recruitment_interval_s=interval_s)
    expected = {}
    for number in (interval_s, 2 * interval_s):
        for since in range(STEPS.order):
            expected[number + since] = (number, STEPS.order - since)
    found = {pulse: (order.number, order.ttl) for pulse, order in enumerate(said, 1) if order}
    assert found == expected


def test_the_order_names_the_weakest_leaf_and_a_legal_place() -> None:
    root = a_root()
    strong = child(3, (ME,), (43, 50), score=1)
    (order,) = {order[:3] for order in orders(root.steps(60, leaf_frame(), strong)) if order}
    place = (order[1] / 100, order[2] / 100)
    assert order[0] == LEAF
    assert distance(place, (62, 58)) <= 5
    others = [root.at, (43.0, 50.0)]
    assert all(distance(place, other) >= 6 for other in others)
    assert min(distance(place, other) for other in others) <= 9.98


def test_a_root_without_followers_or_events_gives_no_order() -> None:
    assert not any(orders(a_root().steps(130, events=[event(1, 50, 50)])))
    alone = a_root(recruitment_places="with-events")
    assert not any(orders(alone.steps(130, child(LEAF, (ME,), (58, 50)))))


def test_recruitment_can_be_switched_off() -> None:
    assert not any(with_a_leaf(130, recruitment=False)[1])


def orders_13_s_apart(*others: Member) -> list[set[tuple[int, int, int]]]:
    """Leaf and place of a root's first two orders: when it gives the second, the first leaf is under way."""
    root = a_root(recruitment_interval_s=13, recruitment_places="with-events")
    first = orders(root.steps(25, leaf_frame(), *others))
    second = orders(root.steps(13, relocating(LEAF, (58, 50)), *others))
    return [{order[:3] for order in said if order} for said in (first, second)]


WEAK = child(3, (ME,), (50, 58), events=[FAR_EVENT], score=1)


def test_a_movers_place_is_blocked_for_the_next() -> None:
    """Two leaves with the same event to go to are sent to places at least d_min apart."""
    outpost = child(5, (ME,), (60, 64), score=9)
    ((one, *place),), ((other, *other_place),) = orders_13_s_apart(WEAK, outpost)
    assert (one, other) == (LEAF, 3)
    assert distance((place[0], place[1]), (other_place[0], other_place[1])) >= 600


def test_no_leaf_is_sent_where_only_a_mover_will_be() -> None:
    """A mover's place blocks; it is no member yet, so being in range of that place alone is not enough."""
    ((one, *_),), second = orders_13_s_apart(WEAK)
    assert one == LEAF
    assert second == set(), "what is left around the event is out of range of the root"


@given(
    in_arena,
    st.lists(in_arena, min_size=1, max_size=3),
    st.lists(in_arena, max_size=3),
    st.lists(in_arena, min_size=1, max_size=6),
)
def test_places_taken_only_block(leaf: Place, members: list[Place], taken: list[Place], spots: list[Place]) -> None:
    """The place is in range of a member, at least d_min from all, and at least d_min from each place that is taken."""
    place = chosen(leaf, members, [Event(number, *spot) for number, spot in enumerate(spots)], taken)
    if place is not None:
        assert is_legal(place, members, EPSILON)
        assert all(distance(place, other) >= D_MIN_M - EPSILON for other in taken)


def test_a_place_is_blocked_until_the_mover_must_have_arrived() -> None:
    """After the times to get the order, to travel 4.5 m at 0.5 m/s and to find a parent its place is free again."""
    root = a_root(recruitment_interval_s=12, recruitment_places="with-events", speed_mps=0.5)
    ordered = next(order for order in orders(root.steps(14, leaf_frame(), WEAK)) if order)
    travel_s = math.dist((58, 50), (ordered.x_cm / 100, ordered.y_cm / 100)) / 0.5
    free_at = 12 + STEPS.order + travel_s + STEPS.arrival
    said = orders(root.steps(70, relocating(LEAF, (58, 50)), WEAK))
    second = next(order for order in said if order and order.number > 12)
    assert second.leaf == 3
    assert free_at <= second.number < free_at + 12


@given(st.lists(in_arena, min_size=1, max_size=4), st.lists(in_arena, max_size=3), st.integers(0, 2**32))
def test_any_legal_place_may_be_drawn(members: list[Place], taken: list[Place], seed: int) -> None:
    """Within the arena, in range of a member, far enough from all; None only if hardly any place is legal."""
    legal = Legal(members, taken, range_m=RANGE_M, d_min_m=D_MIN_M, size_m=SIZE_M)
    place = legal.draw(random.Random(seed))
    grid = [(x, y) for x in range(31) for y in range(25) if (x, y) in legal]
    if place is None:
        assert len(grid) < 5
        return
    assert (round(place[0]), round(place[1])) in grid
    assert is_legal(place, members, EPSILON)


def test_each_legal_place_is_drawn_as_often() -> None:
    """Also those within range of two members, which are proposed twice as often."""
    legal = Legal([(8.0, 12.0), (15.0, 12.0)], [], range_m=RANGE_M, d_min_m=D_MIN_M, size_m=SIZE_M)
    grid = [(x, y) for x in range(31) for y in range(25) if (x, y) in legal]
    rng = random.Random(3)
    draws = Counter(legal.draw(rng) for _ in range(60 * len(grid)))
    near_both = [cell for cell in grid if math.dist(cell, (8, 12)) <= RANGE_M and math.dist(cell, (15, 12)) <= RANGE_M]
    near_one = [cell for cell in grid if cell not in near_both]
    means = [sum(draws[float(x), float(y)] for x, y in cells) / len(cells) for cells in (near_both, near_one)]
    assert means[0] == pytest.approx(means[1], rel=0.1)


def test_with_no_event_to_sense_a_leaf_goes_to_any_place_if_it_may() -> None:
    for places, expected in (("with-events", 0), ("any", 1)):
        root = a_root(recruitment_interval_s=12, recruitment_places=places)
        said = orders(root.steps(20, child(LEAF, (ME,), (58, 50))))
        assert len({order.number for order in said if order}) == expected
