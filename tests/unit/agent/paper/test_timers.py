"""Timers are seconds, so that trees live as long whatever the length of a step; most have a least number of steps."""

from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper import timers as module
from deltaswarm_agent.controllers.paper.frames import MAX_AGE, MAX_TTL, Member
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_agent.controllers.paper.timers import MAX_HOPS, steps_of, timers
from tests.support.cores import (
    INSIDE,
    OUTSIDE,
    PARENT,
    PARENT_AT,
    ROOT,
    STEPS,
    Lone,
    a_member,
    a_root,
    attending,
    child,
    event,
    member,
)
from tests.support.tiers import in_one_test

STEPS_S = [0.25, 1.0, 5.0]
steps_s = st.floats(0.01, 60.0)


def test_a_step_of_1_s_makes_seconds_steps() -> None:
    assert asdict(STEPS) == {name: round(getattr(module, f"{name.upper()}_S")) for name in asdict(STEPS)}


@given(steps_s, st.floats(0.0, 60.0))
def test_a_timer_is_the_nearest_number_of_steps_or_its_least(step_s: float, latency_s: float) -> None:
    """At least one step, and in short steps as many seconds as its constant says, to half a step."""
    for name, steps in asdict(timers(step_s, latency_s)).items():
        time_s = getattr(module, f"{name.upper()}_S") + (latency_s if name == "trail" else 0.0)
        assert steps >= 1
        if step_s <= 0.5 and not (name == "order" and steps == MAX_HOPS):
            assert abs(steps * step_s - time_s) <= step_s / 2 + 1e-9


@given(steps_s)
def test_what_a_timer_counts_fits_its_field(step_s: float) -> None:
    """Ages and an order's time to live stay within what a frame can say, whatever the length of a step."""
    found = timers(step_s)
    assert max(found.memory, found.gone) + 1 <= MAX_AGE
    assert found.order <= MAX_HOPS == MAX_TTL


@in_one_test(("time_s", "step_s", "steps"), [(12, 5, 2), (12, 60, 1), (60, 0.25, 240), (0.1, 1, 1)])
def test_a_time_is_rounded_to_steps(time_s: float, step_s: float, steps: int) -> None:
    assert steps_of(time_s, step_s) == steps


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_silent_parent_is_lost_after_12_s(step_s: float) -> None:
    """At least 3 steps: one lost frame is no lost parent."""
    lone = a_member(step_s=step_s, dissolution=False)
    joined = lone.now
    while lone.core.state is State.MEMBER:
        lone.step()
    assert lone.now - joined == max(3, round(12 / step_s))


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_pulse_that_stalls_for_20_s_ends_a_membership(step_s: float) -> None:
    """At least 6 steps."""
    lone = a_member(step_s=step_s, dissolution=False)
    joined = lone.now
    while lone.path:
        lone.step(member((ROOT, PARENT), PARENT_AT, pulse=100))
    assert lone.now - joined == max(6, round(20 / step_s))


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_silent_child_leaves_the_table_after_12_s(step_s: float) -> None:
    """As the child loses a silent parent."""
    root = a_root(step_s=step_s)
    root.step(child(2, (root.core.agent,), (58, 50)))
    heard = root.now
    membership = root.core.membership
    assert membership is not None
    while membership.children:
        root.step()
    assert root.now - heard == max(3, round(12 / step_s))


@pytest.mark.parametrize("step_s", STEPS_S)
def test_an_event_that_nobody_senses_is_forgotten_after_12_s(step_s: float) -> None:
    """At least 3 steps; a root then has nothing to report."""
    root = a_root(at=(50.0, 50.0), step_s=step_s, report_every_s=0.01)
    root.at = (50.0, 55.0)
    sensed = root.now
    while root.step().report is not None:
        pass
    assert root.now - sensed == max(3, round(12 / step_s)) + 1


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_root_recruits_each_60_s(step_s: float) -> None:
    root = a_root(step_s=step_s)
    leaf = child(2, (root.core.agent,), (58, 50))
    numbers = set()
    while root.now < round(130 / step_s):
        said = root.step(leaf, events=[event(1, 50, 55)]).radio
        assert isinstance(said, Member)
        numbers |= {said.order.number} if said.order else set()
    assert numbers == {round(60 / step_s), round(120 / step_s)}


@pytest.mark.parametrize(("latency_s", "joins"), [(0.0, False), (5.0, True)])
@pytest.mark.parametrize("says", ["attending", "member"])
def test_the_trail_covers_the_radios_latency(latency_s: float, joins: bool, says: str) -> None:
    """With 5 s latency an agent hears of a tree that long after it came into range, and joins all the same."""
    lone = Lone(at=OUTSIDE, latency_s=latency_s)
    lone.step()
    lone.at = INSIDE
    lone.steps(5)
    said = attending(PARENT, PARENT_AT, 4, PARENT_AT) if says == "attending" else member((PARENT,), PARENT_AT)
    lone.step(said)
    assert (lone.core.state is not State.WALKING) == joins


def test_places_of_steps_in_which_an_agent_was_not_asked_are_on_its_trail() -> None:
    """An agent that slept while it walked into range joins as one that was asked in each step."""
    lone = Lone(at=(70.0, 50.0))
    lone.step()
    way = [(70.0 - x, 50.0) for x in range(1, 11)]
    lone.step(member((PARENT,), PARENT_AT), at=INSIDE, skip=len(way), poses=way)
    assert lone.core.state is State.MEMBER
    lone = Lone(at=(70.0, 50.0))
    lone.step()
    stays = [INSIDE] * STEPS.trail
    lone.step(member((PARENT,), PARENT_AT), at=INSIDE, skip=len(stays), poses=stays)
    assert lone.core.state is State.WALKING
