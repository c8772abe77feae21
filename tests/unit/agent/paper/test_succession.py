"""Succession: a tree whose root falls silent goes on under the first of its children."""

import pytest

from deltaswarm_agent.controllers.paper.states import Cause, State
from tests.support.cores import PARENT_AT, STEPS, Crowd, Lone, a_member, a_root, child, event, member

CONTROL = {"root_succession": True, "mode": "hierarchical", "rho": 1, "gamma_max": 1000}
AT = {1: (58.0, 50.0), 2: (51.0, 57.0), 3: (50.0, 42.0), 4: (64.0, 52.0)}
"""Places of agents below agent 9 at (50, 50): 1, 2 and 3 are its children, and 4 is a child of 1."""


def a_tree(**control: object) -> Crowd:
    """A root, its three children, and a grandchild."""
    crowd = Crowd(a_root((50.0, 50.0), 9, **{**CONTROL, **control}))
    for agent, (x_m, y_m) in AT.items():
        crowd.step()
        lone = Lone(agent, (x_m + 30, y_m), **{**CONTROL, **control})
        lone.step(skip=crowd.lones[9].now)
        lone.at = (x_m, y_m)
        crowd.lones[agent] = lone
        crowd.step()
    assert paths(crowd) == {9: (9,), 1: (9, 1), 2: (9, 2), 3: (9, 3), 4: (9, 1, 4)}
    for _ in range(3):
        crowd.step()
    return crowd


def die(crowd: Crowd, *agents: int) -> None:
    crowd.step(silent=agents)
    for agent in agents:
        del crowd.lones[agent]


def paths(crowd: Crowd) -> dict[int, tuple[int, ...]]:
    return {agent: lone.path for agent, lone in crowd.lones.items()}


def test_the_first_child_takes_the_place_of_a_silent_root() -> None:
    """With its own subtree; who is in its range joins it, who is not is free in the end. The pulse goes on."""
    crowd = a_tree()
    pulse = crowd.lones[9].core.membership.pulse
    die(crowd, 9)
    for _ in range(STEPS.silence + STEPS.orphan + 3):
        crowd.step()
    found = paths(crowd)
    assert found[1] == (1,)
    assert found[4] == (1, 4)
    assert crowd.lones[1].core.membership.pulse == pulse + STEPS.silence + STEPS.orphan + 3
    assert found[2] in ((), (1, 2))
    assert found[3] in ((), (1, 3))


def test_who_hears_the_new_root_stays_in_the_tree() -> None:
    """A sibling within reach, and what is below it."""
    crowd = a_tree()
    crowd.lones[3].at = (57.0, 43.0)
    for _ in range(2):
        crowd.step()
    die(crowd, 9)
    for _ in range(STEPS.silence + STEPS.orphan + 3):
        crowd.step()
    assert paths(crowd)[3] == (1, 3)


@pytest.mark.parametrize(("succession", "dead"), [(False, (9,)), (True, (9, 1))])
def test_a_tree_without_a_successor_dissolves(succession: bool, dead: tuple[int, ...]) -> None:
    """As in the paper's reading of this project; the others leave it to the first child, whom they cannot ask."""
    crowd = a_tree(root_succession=succession)
    die(crowd, *dead)
    for _ in range(STEPS.stall + STEPS.orphan):
        crowd.step()
    assert set(paths(crowd).values()) == {()}


def test_an_old_root_that_was_only_silent_is_the_senior() -> None:
    """Its pulse is a step ahead, so the new one yields, and nobody is in two trees."""
    crowd = a_tree()
    for _ in range(STEPS.silence + 1):
        crowd.step(silent=(9,))
    assert crowd.lones[1].path == (1,)
    for _ in range(STEPS.contested + STEPS.silence):
        crowd.step()
    assert {path[0] for path in paths(crowd).values() if path} == {9}
    assert crowd.lones[1].path == (9, 1)


@pytest.mark.parametrize("level", [2, 3])
def test_only_children_of_the_root_succeed(level: int) -> None:
    path = tuple(range(100, 100 + level))
    lone = a_member(path, root_succession=True)
    lone.steps(STEPS.silence + 1)
    assert lone.core.state is State.ORPHAN


def test_a_root_that_leaves_on_purpose_has_no_successor() -> None:
    crowd = a_tree()
    root = crowd.lones[9].core.controller.agent
    root.founds_from = 10_000
    root.leave_tree(Cause.RECALLED)
    for _ in range(5):
        crowd.step()
    assert set(paths(crowd).values()) == {()}


def test_a_successor_recruits_as_a_root_does() -> None:
    lone = a_member((1,), root_succession=True, recruitment_interval_s=13, gamma_max=1000)
    leaf = child(8, (1, 7), (66.0, 50.0))
    for pulse in range(101, 110):
        lone.step(member((1,), PARENT_AT, pulse=pulse), leaf, events=[event(1, 60, 50)])
    said = lone.steps(40, child(8, (7,), (66.0, 50.0)), events=[event(1, 60, 50)])
    assert lone.path == (7,)
    orders = {one.radio.order.number for one in said if one.radio and getattr(one.radio, "order", None)}
    assert orders
