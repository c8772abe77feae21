"""Dissolution: gamma falls by the level each second, an event renews it, and a subtree leaves hop by hop."""

import math
from typing import Any

import pytest

from deltaswarm_agent.controllers.paper.frames import Attending, Leaving, Member, RecruitmentOrder
from deltaswarm_agent.controllers.paper.states import FREE, State
from deltaswarm_wire.messages import Event
from tests.support.cores import (
    INSIDE,
    ME,
    PARENT,
    PARENT_AT,
    ROOT,
    STEPS,
    a_chain,
    a_member,
    a_root,
    cm,
    event,
    leaving,
    member,
    relocating,
)


def parent_says(pulse: int, **more: Any) -> Member:
    return member((ROOT, PARENT), PARENT_AT, pulse=pulse, **more)


@pytest.mark.parametrize("level", [1, 2, 3, 7])
@pytest.mark.parametrize("gamma_max", [50, 20])
def test_gamma_falls_by_the_level_each_second(level: int, gamma_max: int) -> None:
    """Without an event in sight an agent is free after gamma_max / level seconds, rounded up to steps."""
    path = tuple(range(100, 100 + level))
    lone = a_member(path, gamma_max=gamma_max)
    for step in range(2, math.ceil(gamma_max / level)):
        lone.step(member(path, PARENT_AT, pulse=100 + step))
        assert lone.gamma == gamma_max - step * level
    lone.step(member(path, PARENT_AT, pulse=200))
    assert lone.core.state is State.WALKING


@pytest.mark.parametrize("step_s", [0.1, 0.25, 1.0, 5.0])
@pytest.mark.parametrize("level", [1, 2])
def test_gamma_is_in_seconds(step_s: float, level: int) -> None:
    """A member of level 1 dissolves after gamma_max seconds without an event; also with steps that no float holds."""
    path = tuple(range(100, 100 + level))
    lone = a_member(path, gamma_max=60, step_s=step_s)
    joined = lone.now
    while lone.path:
        lone.step(member(path, PARENT_AT, pulse=100 + lone.now))
    assert lone.now - joined + 1 == round(60 / level / step_s)


def test_adoption_does_not_renew_an_orphans_gamma() -> None:
    """Only an event does; else a tree that keeps losing its parents would never dissolve."""
    lone = a_member()
    for pulse in range(101, 111):
        lone.step(parent_says(pulse))
    before = lone.gamma
    lone.step(relocating(PARENT, PARENT_AT))
    assert lone.core.state is State.ORPHAN
    lone.step(member((ROOT, 5), (59.0, 57.0), pulse=112))
    assert lone.path == (ROOT, 5, ME)
    assert lone.gamma == before == 50 - 11 * 2


def test_arrival_renews_a_recruited_agents_gamma() -> None:
    """It was sent to where events are known to be, and needs time to sense them."""
    lone = a_member()
    for pulse in range(101, 111):
        lone.step(parent_says(pulse))
    lone.step(parent_says(111, order=RecruitmentOrder(ME, cm(INSIDE[0]), cm(INSIDE[1]), 111, 12)))
    assert lone.core.state is State.RELOCATING
    lone.step(parent_says(112))
    assert (lone.core.state, lone.gamma) == (State.MEMBER, 50)


def test_a_sensed_event_restores_gamma() -> None:
    lone = a_member()
    for pulse in range(101, 121):
        lone.step(parent_says(pulse))
    assert lone.gamma == 50 - 21 * 2
    lone.step(parent_says(121), events=[event(1, *INSIDE)])
    assert lone.gamma == 50


def test_dissolution_can_be_switched_off() -> None:
    lone = a_member(dissolution=False)
    for pulse in range(101, 400):
        lone.step(parent_says(pulse))
    assert (lone.core.state, lone.gamma) == (State.MEMBER, 50)


def test_a_subtree_leaves_hop_by_hop() -> None:
    """An agent that dissolves takes all below it along, one level per step; those above stay."""
    crowd = a_chain(5, gamma_max=100)
    sees = {agent: [event(1, *lone.at)] for agent, lone in crowd.lones.items() if agent != 2}
    freed: dict[int, int] = {}
    for step in range(80):
        crowd.step(sees)
        for agent, lone in crowd.lones.items():
            if lone.core.state in FREE:
                freed.setdefault(agent, step)
    assert freed == {2: freed[2], 3: freed[2] + 1, 4: freed[2] + 2}
    assert crowd.lones[1].core.membership is not None
    assert crowd.lones[1].core.membership.table() == ()


@pytest.mark.parametrize(("events", "then"), [([], type(None)), ([event(1, *INSIDE)], Attending)])
def test_leaving_is_said_in_four_frames_before_anything_else(events: list[Event], then: type) -> None:
    """One a step, from the step in which the agent leaves; then it is silent, or says which event it attends."""
    lone = a_member()
    said = [lone.step(leaving(PARENT, PARENT_AT), events=events), *lone.steps(9, events=events)]
    assert [type(decision.radio) for decision in said] == [Leaving] * STEPS.leaving + [then] * (10 - STEPS.leaving)


@pytest.mark.parametrize("step_s", [0.5, 1.0, 4.0])
def test_an_idle_root_leaves_if_it_may(step_s: float) -> None:
    """After gamma_max seconds without an event or a follower; the paper's root stays."""
    goes, stays = (a_root(idle_root=what, gamma_max=40, step_s=step_s) for what in ("leaves", "stays"))
    for root in (goes, stays):
        root.steps(round(40 / step_s) - 1)
        assert root.core.state is State.ROOT
        root.step()
    assert goes.core.state is State.WALKING
    assert stays.core.state is State.ROOT


def test_a_root_with_a_follower_or_an_event_is_not_idle() -> None:
    """Its time begins anew when the last of both is gone."""
    root = a_root(idle_root="leaves", gamma_max=40)
    root.steps(100, member((ME, 2), (58, 50)))
    root.steps(30)
    root.step(events=[event(1, 50, 50)])
    root.steps(39)
    assert root.core.state is State.ROOT
    root.step()
    assert root.core.state is State.WALKING
