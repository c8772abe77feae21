"""The paper's control, rule by rule, with hand-made frames: free agents, founding, joining, what an agent says."""

import math
from typing import Any

import pytest

from deltaswarm_agent.controllers.paper.frames import (
    MAX_PATH,
    MAX_TABLE,
    Attending,
    Descendant,
    Member,
    Sighting,
    decode,
    encode,
)
from deltaswarm_agent.controllers.paper.states import FREE, State
from deltaswarm_wire.messages import Event
from tests.support.cores import (
    INSIDE,
    ME,
    OUTSIDE,
    PARENT,
    PARENT_AT,
    ROOT,
    STEPS,
    Lone,
    StepAnswer,
    a_member,
    a_root,
    attending,
    child,
    event,
    leaving,
    member,
    relocating,
)
from tests.support.tiers import in_one_test


def velocity(decision: StepAnswer) -> tuple[float, float]:
    return decision.act.vx_mps, decision.act.vy_mps


def at_event(number: int = 1, **control: Any) -> Lone:
    """An agent that has come to an event at (50, 50) and attends it."""
    lone = Lone(**control)
    lone.step(events=[event(number, 50, 50)])
    assert lone.core.state is State.ATTENDING
    return lone


def test_the_nearest_sensed_event_is_gone_to() -> None:
    lone = Lone(mode="decentralised")
    assert velocity(lone.step(events=[event(1, 50, 53), event(2, 48, 50)])) == (-1.0, 0.0)
    lone = Lone(mode="decentralised")
    assert velocity(lone.step(events=[event(2, 50, 52), event(1, 52, 50)])) == (1.0, 0.0)


def test_an_event_is_observed_at_the_event_only() -> None:
    """On the way nothing is observed, said or reported; at the event it is each step, standing still."""
    lone, here = Lone(at=(50.0, 46.5)), event(1, 50, 50)
    for _ in range(4):
        decision = lone.go_where_it_wants(events=[here])
        assert (decision.act.observed, decision.radio, decision.report) == ((), None, None)
    for step in range(4, 8):
        decision = lone.go_where_it_wants(events=[here])
        assert decision.act.observed == (1,)
        assert velocity(decision) == (0.0, 0.0)
        assert decision.radio == Attending(ME, 5000, 5000, 1, 5000, 5000)
        assert decision.report is not None
        assert (decision.report.role, decision.report.events) == ("attending", (here,))
        assert (decision.report.sequence, decision.report.step) == (step - 4, step)


def reported(decision: StepAnswer) -> list[int]:
    return [] if decision.report is None else [found.event for found in decision.report.events]


@pytest.mark.parametrize("mode", ["hierarchical", "hybrid", "decentralised"])
@pytest.mark.parametrize("step_s", [1.0, 0.5])
def test_a_find_is_reported_once_by_whoever_is_outside_trees(mode: str, step_s: float) -> None:
    """On the way to it or past it, in the step in which it is sensed first; when met again, again."""
    lone = Lone(at=(50.0, 46.5), mode=mode, report_finds=True, rho=9, delta=9, step_s=step_s)
    here = event(1, 50, 50)
    assert [reported(lone.step(events=sensed)) for sensed in ((), (here,), (here,), (), (here,))] == [
        [],
        [1],
        [],
        [],
        [1],
    ]
    assert reported(lone.step(events=[here], skip=3)) == [1]


def test_an_agent_at_an_event_reports_another_beside_it_once() -> None:
    lone, own, other = at_event(mode="decentralised", report_finds=True), event(1, 50, 50), event(2, 51, 50)
    assert [reported(one) for one in lone.steps(3, events=[own, other])] == [[1, 2], [1], [1]]
    assert reported(Lone(mode="decentralised", report_finds=True).step(events=[own])) == [1]


def test_a_member_leaves_reports_to_its_root() -> None:
    """What it senses is in its frame."""
    lone = a_member(report_finds=True)
    assert lone.step(member((ROOT, PARENT), PARENT_AT, pulse=101), events=[event(7, 59, 50)]).report is None


@pytest.mark.parametrize("member_observes", ["all", "nearest"])
def test_a_free_agent_observes_one_event_at_a_time(member_observes: str) -> None:
    """Even where two are at one place, and whatever members of trees may do."""
    lone = Lone(mode="decentralised", member_observes=member_observes)
    both = [event(1, 50, 50), event(2, 50, 50)]
    assert {decision.act.observed for decision in lone.steps(5, events=both)} == {(1,)}


def test_another_event_does_not_call_an_agent_away() -> None:
    """It stays until its event is complete, though another is sensed, or heard of."""
    lone = at_event(mode="decentralised")
    lone.step(events=[event(1, 50, 50)], at=(50.0, 50.0))
    heard = attending(PARENT, (58, 50), 9, (58, 50))
    for decision in lone.steps(3, heard, events=[event(1, 50, 50), event(2, 51, 50)]):
        assert decision.act.observed == (1,)


def test_after_completion_another_sensed_event_is_gone_to_at_once() -> None:
    decision = at_event().step(events=[event(2, 50, 53), event(3, 48, 50)])
    assert velocity(decision) == (-1.0, 0.0)
    assert (decision.act.observed, decision.radio, decision.report) == ((), None, None)


def test_after_completion_the_agent_walks_on_if_it_senses_nothing() -> None:
    """It is silent again, and moves at full speed."""
    lone = at_event()
    decision = lone.step()
    assert lone.core.state is State.WALKING
    assert math.hypot(*velocity(decision)) == pytest.approx(1.0)
    assert (decision.act.observed, decision.radio, decision.report) == ((), None, None)


def test_an_agent_newly_in_range_of_an_attending_one_goes_to_its_event() -> None:
    """To the event that it was told, not to the teller."""
    lone = Lone(at=OUTSIDE)
    lone.step()
    decision = lone.step(attending(PARENT, PARENT_AT, 4, (59, 47)), at=INSIDE)
    assert velocity(decision) == (0.0, -1.0)
    assert lone.core.state is State.GOING


def test_a_neighbour_that_begins_to_attend_while_in_range_is_not_joined() -> None:
    """Newly in range is literal: the agent must have moved into range."""
    lone = Lone(at=INSIDE)
    lone.steps(2)
    lone.steps(10, attending(PARENT, PARENT_AT, 4, PARENT_AT))
    assert lone.core.state is State.WALKING


@pytest.mark.parametrize(("inside_steps", "joins"), [(STEPS.trail, True), (STEPS.trail + 1, False)])
@pytest.mark.parametrize("says", ["attending", "member"])
def test_newly_looks_back_upon_a_few_positions(inside_steps: int, joins: bool, says: str) -> None:
    """Out of range at one of the last 4 positions is new; 5 steps ago is not."""
    lone = Lone(at=OUTSIDE)
    lone.step()
    lone.at = INSIDE
    lone.steps(inside_steps - 1)
    heard = attending(PARENT, PARENT_AT, 4, PARENT_AT) if says == "attending" else member((PARENT,), PARENT_AT)
    lone.step(heard)
    assert (lone.core.state is not State.WALKING) == joins


def test_an_event_that_the_agent_senses_itself_wins() -> None:
    """Over what it hears at the same time, and over what it is on its way to."""
    heard = attending(PARENT, PARENT_AT, 4, PARENT_AT)
    lone = Lone(at=OUTSIDE)
    lone.step()
    assert velocity(lone.step(heard, events=[event(5, 59, 52)], at=INSIDE)) == (0.0, 1.0)
    lone = Lone(at=OUTSIDE)
    lone.step()
    assert velocity(lone.step(heard, at=INSIDE)) == (-1.0, 0.0)
    assert velocity(lone.step(events=[event(5, 59, 52)])) == (0.0, 1.0)


def test_an_agent_walks_on_where_an_event_should_be_and_is_not() -> None:
    lone = Lone(at=OUTSIDE)
    lone.step()
    lone.step(attending(PARENT, PARENT_AT, 4, PARENT_AT), at=INSIDE)
    lone.step(at=(55.0, 50.0))
    assert lone.core.state is State.GOING
    lone.step(at=(54.9, 50.0))
    assert lone.core.state is State.WALKING


@pytest.mark.parametrize(("mode", "threshold"), [("hybrid", 3), ("hybrid", 5), ("hierarchical", 2)])
def test_a_root_is_founded_at_the_threshold(mode: str, threshold: int) -> None:
    """Delta in hybrid, rho in hierarchical control, where the agent stands; not with one event less."""
    control = {"delta": threshold} if mode == "hybrid" else {"rho": threshold}
    events = [event(number, 50, 50 + number / 2) for number in range(threshold)]
    lone = Lone(mode=mode, **control)
    lone.step(events=events[1:])
    assert lone.core.state in FREE
    decision = lone.step(events=events)
    assert (lone.core.state, lone.path) == (State.ROOT, (ME,))
    assert velocity(decision) == (0.0, 0.0)
    assert isinstance(decision.radio, Member)
    assert decision.report is not None


@pytest.mark.parametrize("orphan", [False, True])
def test_no_root_is_founded_where_a_member_is_heard(orphan: bool) -> None:
    """Whatever its tree and distance: else many permanent roots form side by side."""
    lone = Lone(delta=1)
    lone.steps(5, member((PARENT,), (51, 50), orphan=orphan), events=[event(1, 50, 53)])
    assert lone.core.state in FREE
    lone.step(leaving(PARENT, (51, 50)), attending(2, (51, 50), 1, (50, 53)), events=[event(1, 50, 53)])
    assert lone.core.state is State.ROOT


def test_decentralised_agents_found_no_trees() -> None:
    lone = Lone(mode="decentralised", delta=1, rho=1)
    lone.steps(20, events=[event(number, 50, 50 + number / 10) for number in range(10)])
    assert lone.core.state is State.ATTENDING


@in_one_test(("distance_m", "joins"), [(5.999, False), (6.0, True), (9.979, True), (9.981, False)])
def test_a_parent_is_at_least_d_min_away_and_2_cm_within_range(distance_m: float, joins: bool) -> None:
    """The 2 cm: places are rounded on the air, and who joins at 10.003 m is never heard again."""
    lone = Lone(at=OUTSIDE)
    lone.step()
    decision = lone.step(member((ROOT, PARENT), PARENT_AT, pulse=40), at=(50.0 + distance_m, 50.0))
    assert (lone.core.state is State.MEMBER) == joins
    if joins:
        assert isinstance(decision.radio, Member)
        assert decision.radio[3:6] == (False, (ROOT, PARENT, ME), 40)
        assert velocity(decision) == (0.0, 0.0)
        assert lone.gamma <= 50


@pytest.mark.parametrize("before", [State.WALKING, State.GOING, State.ATTENDING])
def test_any_free_agent_joins(before: State) -> None:
    lone = Lone(at=OUTSIDE)
    sensed = {State.WALKING: [], State.GOING: [event(1, 60, 50)], State.ATTENDING: [event(1, *OUTSIDE)]}[before]
    lone.step(events=sensed)
    assert lone.core.state is before
    lone.step(member((PARENT,), PARENT_AT), events=sensed, at=INSIDE)
    assert lone.path == (PARENT, ME)


def test_the_nearest_member_becomes_the_parent() -> None:
    """The lower id among equals; one too near, too far, orphaned or long in range is none."""
    lone = Lone(at=(50.0, 39.4))
    lone.step()
    tree = [
        member((5,), (50, 49.5)),
        member((4,), (58, 48)),
        member((3,), (42, 48)),
        member((2,), (50, 51), orphan=True),
        member((6,), (50, 45)),
        member((8,), (50, 34)),
    ]
    lone.step(*tree, at=(50.0, 42.0))
    assert lone.path == (5, ME)
    lone = Lone(at=(50.0, 39.4))
    lone.step()
    lone.step(*tree[1:], at=(50.0, 42.0))
    assert lone.path == ()
    lone.step(*tree[1:], at=(50.0, 44.0))
    assert lone.path == (3, ME)


@pytest.mark.parametrize("above", [(ROOT, ME), tuple(range(100, 100 + MAX_PATH - 1))], ids=["itself", "too long"])
def test_no_free_agent_joins_below_itself_or_beyond_the_longest_path(above: tuple[int, ...]) -> None:
    """A member that still counts it among its ancestors is no parent, nor is one at the end of a longest path."""
    lone = Lone(at=OUTSIDE)
    lone.step()
    lone.step(member((*above, PARENT), PARENT_AT, pulse=40), at=INSIDE)
    assert lone.core.state is State.WALKING


def test_events_of_other_trees_are_not_believed_in() -> None:
    """Only frames with the same root count: another tree has its own root to report them."""
    root = a_root()
    other = member((9, 5), (58, 50), events=[Sighting(3, 6000, 5000, 0)])
    assert root.step(other).report is None
    assert root.step(child(2, (ME,), (42, 50), events=[Sighting(4, 4000, 5000, 0)])).report is not None


def test_hierarchical_free_agents_only_walk() -> None:
    """They never attend, observe, speak or report, whatever they sense and hear."""
    lone = Lone(at=OUTSIDE, mode="hierarchical", rho=2)
    lone.step()
    heard = attending(PARENT, PARENT_AT, 1, PARENT_AT)
    for at in (INSIDE, (58.0, 50.0), (50.0, 50.0)):
        decision = lone.step(heard, events=[event(1, *PARENT_AT)], at=at)
        assert math.hypot(*velocity(decision)) == pytest.approx(1.0)
        assert (decision.act.observed, decision.radio, decision.report) == ((), None, None)
    assert lone.core.state is State.WALKING


@pytest.mark.parametrize(("member_observes", "observed"), [("nearest", (2,)), ("all", (1, 2, 3))])
def test_tree_agents_stand_and_observe_what_they_sense(member_observes: str, observed: tuple[int, ...]) -> None:
    """A member, a root, also an orphan: from where they stand, the nearest event or all of them."""
    sensed = [event(1, 59, 54), event(2, 58, 50), event(3, 59, 47)]
    lone = a_member(member_observes=member_observes)
    for heard in (member((ROOT, PARENT), PARENT_AT, pulse=101), relocating(PARENT, PARENT_AT)):
        decision = lone.step(heard, events=sensed)
        assert (decision.act.observed, velocity(decision)) == (observed, (0.0, 0.0))
    assert lone.core.state is State.ORPHAN
    root = Lone(at=INSIDE, member_observes=member_observes)
    assert root.step(events=sensed).act.observed == observed
    assert root.core.state is State.ROOT


def test_members_report_to_nobody() -> None:
    for decision in a_member().steps(5, events=[event(1, *INSIDE), event(2, *INSIDE)]):
        assert decision.report is None
        assert isinstance(decision.radio, Member)
        assert decision.radio.score == 2
        assert {sighting.event for sighting in decision.radio.events} == {1, 2}


def test_a_root_reports_while_its_tree_believes_in_an_event() -> None:
    """Each step, with the number of its followers; not when it believes in none."""
    root = a_root()
    follower = child(2, (ME,), (58, 50), events=[Sighting(9, 6000, 5000, 0)])
    report = root.step(follower).report
    assert report is not None
    assert (report.role, report.followers) == ("root", 1)
    assert report.events == (Event(9, 60.0, 50.0),), "the root's own event is gone"
    silent = [root.step(child(2, (ME,), (58, 50))).report is None for _ in range(15)]
    assert silent == [False] * 11 + [True] * 4


def test_the_longest_table_can_be_said() -> None:
    wide = [Descendant(60_000 + row, 2, -(2**31) + 1, 2**31 - 1, 65_535) for row in range(600)]
    broods = [child(2, (ME,), (58, 50), table=wide[:300]), child(3, (ME,), (58, 50), table=wide[300:])]
    decision = a_root().step(*broods, events=[event(1, 50, 50)])
    assert isinstance(decision.radio, Member)
    assert len(decision.radio.table) == MAX_TABLE
    assert decode(ME, encode(decision.radio)) == decision.radio
    assert decision.report is not None
    assert decision.report.followers == MAX_TABLE
