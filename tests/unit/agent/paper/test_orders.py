"""Active recruitment: how an order gets to its leaf, and what the leaf does."""

from typing import Any

import pytest

from deltaswarm_agent.controllers.paper.frames import Descendant, Leaving, Member, RecruitmentOrder, Relocating
from deltaswarm_agent.controllers.paper.states import State
from tests.support.cores import (
    INSIDE,
    ME,
    PARENT,
    PARENT_AT,
    ROOT,
    STEPS,
    Lone,
    Place,
    a_member,
    child,
    cm,
    event,
    leaving,
    member,
)
from tests.support.tiers import in_one_test
from tests.unit.agent.paper.test_recruitment import distance, leaf_frame, orders


def order_to(leaf: int, place: Place = (56.0, 56.0), number: int = 1, ttl: int = 12) -> RecruitmentOrder:
    return RecruitmentOrder(leaf, cm(place[0]), cm(place[1]), number, ttl)


def parent_says(pulse: int, order: RecruitmentOrder | None) -> Member:
    return member((ROOT, PARENT), PARENT_AT, pulse=pulse, order=order)


@in_one_test(("leaf", "ttl", "relayed"), [(9, 12, True), (9, 2, True), (9, 1, False), (8, 12, False)])
def test_an_order_is_relayed_only_towards_its_leaf(leaf: int, ttl: int, relayed: bool) -> None:
    """By those with the leaf in their table, once per hearing, while it has time to live."""
    lone = a_member()
    below = Descendant(9, 4, 0, 0, 0)
    mine = child(4, lone.path, (59, 58), table=[below])
    decision = lone.step(parent_says(101, order_to(leaf, ttl=ttl)), mine)
    assert orders([decision]) == [order_to(leaf, ttl=ttl - 1) if relayed else None]
    assert orders([lone.step(parent_says(102, None), mine)]) == [None]


def test_an_order_from_elsewhere_is_neither_obeyed_nor_relayed() -> None:
    lone = a_member()
    stranger = member((ROOT, 5), (59, 42), pulse=101, order=order_to(ME))
    lone.step(stranger, parent_says(101, None))
    assert lone.core.state is State.MEMBER


def test_an_order_under_way_ends_with_its_tree() -> None:
    """Who relays one and leaves in the same step does not say it in a tree of its own."""
    lone = a_member(gamma_max=4, delta=1)
    lone.step(parent_says(101, order_to(4)), child(4, lone.path, (59, 58)))
    assert lone.core.state is State.WALKING
    decision = lone.step(events=[event(1, *INSIDE)])
    assert (lone.core.state, orders([decision])) == (State.ROOT, [None])


def test_an_agent_with_children_refuses() -> None:
    lone = a_member()
    lone.step(parent_says(101, order_to(ME)), child(4, lone.path, (59, 58)))
    assert lone.core.state is State.MEMBER


def sent(place: Place = (56.0, 56.0), number: int = 1) -> Lone:
    lone = a_member()
    decision = lone.go_where_it_wants(parent_says(101, order_to(ME, place, number)))
    assert isinstance(decision.radio, Relocating)
    return lone


def test_a_mover_travels_says_so_and_does_nothing_else() -> None:
    """Straight to the place at full speed; whatever it senses it leaves to others, and it reports nothing."""
    lone = sent()
    while distance(lone.at, (56, 56)) > 0.01:
        before_m = distance(lone.at, (56, 56))
        decision = lone.go_where_it_wants(parent_says(105, None), events=[event(1, *lone.at)])
        assert isinstance(decision.radio, Relocating)
        assert (decision.act.observed, decision.report) == ((), None)
        assert distance(lone.at, (56, 56)) == pytest.approx(max(0.0, before_m - 1))


def test_an_order_is_obeyed_once() -> None:
    """On arrival the mover is a member again; the order it has done is no order, the next one is."""
    lone = sent(INSIDE)
    lone.step(parent_says(102, order_to(ME, INSIDE)))
    assert (lone.core.state, lone.path) == (State.MEMBER, (ROOT, PARENT, ME))
    lone.step(parent_says(103, order_to(ME)))
    assert lone.core.state is State.MEMBER
    lone.step(parent_says(104, order_to(ME, number=2)))
    assert lone.core.state is State.RELOCATING


def test_a_restarted_roots_first_order_is_followed() -> None:
    """An order's number is the step, which does not begin anew with the root's pulse."""
    old, new = (a_root_since(step, recruitment_interval_s=13) for step in (0, 100))
    first, second = (order for root in (old, new) for order in orders(root.steps(13, leaf_frame())) if order)
    assert (first.number, second.number) == (13, 113)
    lone = sent(INSIDE, number=first.number)
    lone.step(parent_says(102, None))
    assert lone.core.state is State.MEMBER
    lone.step(parent_says(13, order_to(ME, number=second.number)))
    assert lone.core.state is State.RELOCATING


def a_root_since(step: int, **control: Any) -> Lone:
    root = Lone(mode="hierarchical", rho=1, **control)
    root.step(events=[event(1, 50, 50)], skip=step)
    assert root.path == (ME,)
    return root


def test_an_order_is_forgotten_when_a_tree_is_entered_anew() -> None:
    """An agent that left and joined again obeys an order with the number of the last one that it obeyed."""
    lone = sent(INSIDE)
    lone.step(parent_says(102, None))
    lone.step(leaving(PARENT, PARENT_AT))
    assert lone.core.state is State.WALKING
    lone.steps(STEPS.previous_tree)
    lone.step(at=(61.0, 50.0))
    lone.step(parent_says(150, None), at=INSIDE)
    assert lone.core.state is State.MEMBER
    lone.step(parent_says(151, order_to(ME)))
    assert lone.core.state is State.RELOCATING


@pytest.mark.parametrize("pulse", [101, 102])
def test_a_mover_attaches_to_a_fresh_pulse_only(pulse: int) -> None:
    """Newer than the one with which it left; other trees are no matter to it."""
    lone = sent(INSIDE)
    lone.step(member((ROOT, 5), (51, 50), pulse=pulse), member((6,), (52, 50), pulse=900))
    assert (lone.path == (ROOT, 5, ME)) == (pulse == 102)


def test_a_mover_attaches_to_the_nearest_legal_member() -> None:
    """At its place; closer ones only after 3 steps."""
    lone = sent(INSIDE)
    near, legal = (56.0, 50.0), (59.0, 57.0)
    for waited in range(STEPS.arrival_strict):
        lone.step(member((ROOT, 4), near, pulse=102 + waited))
        assert lone.core.state is State.RELOCATING
    lone.step(member((ROOT, 4), near, pulse=105), member((ROOT, 5), legal, pulse=105))
    assert lone.path == (ROOT, 4, ME)
    lone = sent(INSIDE)
    lone.step(member((ROOT, 4), near, pulse=102), member((ROOT, 5), legal, pulse=102), parent_says(102, None))
    assert lone.path == (ROOT, 5, ME)


def test_a_mover_that_finds_nobody_gives_up() -> None:
    """It says that it relocates for 8 steps at its place, then that it leaves, and is free."""
    lone = sent(INSIDE)
    waiting = lone.steps(STEPS.arrival)
    assert all(isinstance(decision.radio, Relocating) for decision in waiting)
    assert all((decision.act.vx_mps, decision.act.vy_mps) == (0.0, 0.0) for decision in waiting)
    assert isinstance(lone.step().radio, Leaving)
    assert lone.core.state is State.WALKING
