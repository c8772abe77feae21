"""Trees by message: tables, pulses, dissolution, lost parents, and what keeps cycles away."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.frames import MAX_TABLE, Descendant, Leaving, Member, PaperFrame
from deltaswarm_agent.controllers.paper.membership import Membership, is_fresh
from deltaswarm_agent.controllers.paper.states import State
from tests.support.cores import (
    INSIDE,
    ME,
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
    leaving,
    lives,
    member,
    near_frames,
    relocating,
)
from tests.support.tiers import in_one_test

CHILD, CHILD_AT = 4, (58.0, 50.0)
pulses = st.integers(0, 2**32 - 1)


def parent_says(pulse: int, **more: Any) -> Member:
    return member((ROOT, PARENT), PARENT_AT, pulse=pulse, **more)


@given(lives(near_frames()), st.booleans())
def test_a_table_has_no_agent_twice_and_not_itself(life: list[Any], is_root: bool) -> None:
    """Whatever the children claim, nobody above the agent either, though it name the agent as its parent."""
    membership = Membership(ME, None if is_root else parent_says(1), 0, STEPS)
    for now, (heard, _) in enumerate(life, 1):
        membership.hear_children([frame for frame in heard if frame.sender != ME], now)
        agents = [row.agent for row in membership.table()]
        assert len(set(agents)) == len(agents) <= MAX_TABLE
        assert ME not in agents
        assert not set(agents) & set(membership.path)
        assert set(membership.children) <= {*agents, *membership.path}


def test_rows_for_which_a_table_has_no_room_are_counted() -> None:
    """Two children with as many descendants as a table holds: the rest is cut, and it is known how many."""
    membership = Membership(ME, None, 0, STEPS)
    others = [Descendant(agent, CHILD, 0, 0, 0) for agent in range(1000, 1000 + 2 * MAX_TABLE)]
    tables = (tuple(others[:MAX_TABLE]), tuple(others[MAX_TABLE:]))
    frames = [
        member((ME, agent), CHILD_AT, table=table) for agent, table in zip((CHILD, CHILD + 1), tables, strict=True)
    ]
    membership.hear_children(frames, 1)
    assert len(membership.table()) == MAX_TABLE
    assert membership.rows_cut == 2 + 2 * MAX_TABLE - MAX_TABLE


def test_a_childs_own_word_about_itself_comes_first() -> None:
    """Its sibling may know an older place of it."""
    root = a_root()
    stale = Descendant(CHILD, 5, 0, 0, 9)
    decision = root.step(child(CHILD, (ME,), CHILD_AT, score=1), child(2, (ME,), (42, 50), table=[stale]))
    assert isinstance(decision.radio, Member)
    assert Descendant(CHILD, ME, 5800, 5000, 1) in decision.radio.table
    assert stale not in decision.radio.table


@in_one_test(
    ("says", "stays"),
    [
        (child(CHILD, (ME,), CHILD_AT), True),
        (attending(CHILD, CHILD_AT, 1, CHILD_AT), True),
        (leaving(CHILD, CHILD_AT), False),
        (relocating(CHILD, CHILD_AT), False),
        (child(CHILD, (ME,), CHILD_AT, orphan=True), False),
        (child(CHILD, (ME, 2), CHILD_AT), False),
        (member((CHILD,), CHILD_AT, pulse=0), False),
    ],
)
def test_a_child_is_dropped_when_it_is_none_any_more(says: PaperFrame, stays: bool) -> None:
    """It leaves, relocates, is orphaned, names another parent, or is a root itself."""
    root = a_root(agent=ME, d_min_m=9)
    root.step(child(CHILD, (ME,), CHILD_AT), child(2, (ME,), (42, 50)))
    assert root.core.membership is not None
    assert set(root.core.membership.children) == {CHILD, 2}
    membership = root.core.membership
    membership.hear_children([says], root.now + 1)
    assert set(membership.children) == ({CHILD, 2} if stays else {2})


@given(pulses, st.integers(0, 1000), st.integers(0, 40))
def test_a_living_roots_pulse_is_fresh_unless_it_comes_late(known: int, elapsed: int, late: int) -> None:
    """One that has advanced is trusted if it is at most 8 behind; one that was known before never is."""
    assert is_fresh(known + elapsed - late, known, 50, 50 + elapsed, STEPS.freshness) == (
        late <= STEPS.freshness and late < elapsed
    )


def test_a_roots_first_pulse_on_the_air_is_0() -> None:
    root = Lone(mode="hierarchical", rho=1)
    pulses_said = []
    for _ in range(4):
        radio = root.step(events=[event(1, 50, 50)]).radio
        assert isinstance(radio, Member)
        pulses_said.append(radio.pulse)
    assert pulses_said == [0, 1, 2, 3]


def test_a_member_follows_its_parents_path() -> None:
    """Nothing is announced: whatever changes above shows in the path, also another root with another pulse."""
    lone = a_member()
    lone.step(member((9, ROOT, PARENT), PARENT_AT, pulse=5))
    membership = lone.core.membership
    assert membership is not None
    assert (membership.root, membership.level, membership.parent) == (9, 3, PARENT)
    assert (lone.path, membership.pulse) == ((9, ROOT, PARENT, ME), 5)


@pytest.mark.parametrize("says", [relocating(PARENT, PARENT_AT), attending(PARENT, PARENT_AT, 1, PARENT_AT), None])
def test_whose_parent_is_lost_is_an_orphan_and_says_so(says: PaperFrame | None) -> None:
    """At once if the parent is heard to be no member any more, after 12 steps if it is not heard."""
    lone = a_member()
    if says is None:
        lone.steps(STEPS.silence - 1)
        assert lone.core.state is State.MEMBER
    decision = lone.step(*([says] if says else []))
    assert lone.core.state is State.ORPHAN
    assert isinstance(decision.radio, Member)
    assert (decision.radio.orphan, decision.radio.path) == (True, (ROOT, PARENT, ME))


def test_an_orphaned_parent_is_still_the_parent() -> None:
    """A subtree stays together while its head looks for a new parent."""
    lone = a_member()
    lone.step(parent_says(101, orphan=True))
    assert lone.core.state is State.MEMBER


def test_who_is_in_its_parents_path_is_an_orphan() -> None:
    lone = a_member()
    lone.step(member((ROOT, ME, PARENT), PARENT_AT, pulse=101))
    assert lone.core.state is State.ORPHAN


def an_orphan() -> Lone:
    """One that knows pulse 100 of 1 step ago."""
    lone = a_member()
    lone.step(relocating(PARENT, PARENT_AT))
    assert lone.core.state is State.ORPHAN
    return lone


NEAR_AT, LEGAL_AT = (56.0, 50.0), (59.0, 57.0)


@in_one_test(
    ("frame", "adopts"),
    [
        (member((ROOT, 5), LEGAL_AT, pulse=101), True),
        (member((ROOT, 5), LEGAL_AT, pulse=100), False),
        (member((ROOT, 5), LEGAL_AT, pulse=101, orphan=True), False),
        (member((ROOT, ME, 5), LEGAL_AT, pulse=101), False),
        (member((2, 5), LEGAL_AT, pulse=900), False),
        (member((ROOT, 5), NEAR_AT, pulse=101), False),
        (member((ROOT, 5), (59, 59.99), pulse=101), False),
    ],
)
def test_an_orphan_is_adopted_by_a_fresh_pulse_only(frame: Member, adopts: bool) -> None:
    """By a member of its own tree, not below itself, that has heard of the root since; first at a legal distance."""
    lone = an_orphan()
    lone.step(frame)
    assert (lone.path == (ROOT, 5, ME) and lone.core.state is State.MEMBER) == adopts


def test_an_orphan_takes_any_in_range_at_last() -> None:
    """After 2 steps a member nearer than d_min will do."""
    lone = an_orphan()
    for waited in range(1, STEPS.orphan_strict):
        lone.step(member((ROOT, 5), NEAR_AT, pulse=101 + waited))
        assert lone.core.state is State.ORPHAN
    lone.step(member((ROOT, 5), NEAR_AT, pulse=110))
    assert lone.path == (ROOT, 5, ME)


def test_an_orphan_gives_up_after_5_steps() -> None:
    """It is free, and says that it leaves: so its subtree does too."""
    lone = an_orphan()
    lone.steps(STEPS.orphan - 1)
    assert lone.core.state is State.ORPHAN
    assert isinstance(lone.step().radio, Leaving)
    assert lone.core.state is State.WALKING


def test_an_orphan_far_behind_is_not_adopted_by_a_branch_as_dead_as_itself() -> None:
    """A pulse that is newer than its own, but more than 8 behind what it should be by now, is none."""
    lone = a_member()
    lone.steps(STEPS.silence)
    assert lone.core.state is State.ORPHAN
    lone.step(member((ROOT, 5), LEGAL_AT, pulse=101))
    assert lone.core.state is State.ORPHAN
    lone.step(member((ROOT, 5), LEGAL_AT, pulse=114), events=[])
    assert lone.core.state is State.MEMBER


@pytest.mark.parametrize(("root", "pulse", "joins"), [(ROOT, 100, False), (ROOT, 130, True), (2, 1, True)])
@pytest.mark.parametrize("waited", [STEPS.previous_tree, STEPS.previous_tree + 1])
def test_a_freed_agent_is_careful_with_its_former_tree(root: int, pulse: int, joins: bool, waited: int) -> None:
    """For 20 steps it joins it on a fresh pulse only; other trees at once."""
    lone = a_member()
    lone.step(leaving(PARENT, PARENT_AT))
    lone.at = OUTSIDE
    lone.steps(waited - 1)
    lone.step(member((root, PARENT), PARENT_AT, pulse=pulse), at=INSIDE)
    assert (lone.core.state is State.MEMBER) == (joins or waited > STEPS.previous_tree)
