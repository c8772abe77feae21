"""What an agent makes of what it hears: the newest of each sender, in any order, and nothing malformed."""

import math
import random
from typing import Any

import pytest
from deltaswarm_agent.core import Decision
from deltaswarm_agent.hearing import FORGET_SENDER_STEPS
from hypothesis import given, settings
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.frames import Member, RecruitmentOrder, Sighting, decode_radio, encode_radio
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_wire.codec import MAX_ABS_CM
from deltaswarm_wire.messages import Event, decode_act, decode_report, encode_act, encode_report
from tests.cores import (
    INSIDE,
    ME,
    OUTSIDE,
    PARENT,
    PARENT_AT,
    ROOT,
    Lone,
    a_member,
    a_root,
    attending,
    child,
    leaving,
    lives,
    member,
    near_frames,
)
from tests.strategies import RADIO, complaint, radio_frames, strange

in_arena = st.floats(0.0, 100.0)
far_cm = st.integers(-MAX_ABS_CM, MAX_ABS_CM)


def test_late_and_duplicate_frames_are_dropped() -> None:
    """Of each sender what counts is the newest frame by its counter, whenever it comes."""
    lone = a_member()
    gone = leaving(PARENT, PARENT_AT)
    lone.step(encode_radio(gone._replace(counter=0)), encode_radio(gone._replace(counter=1)))
    assert lone.core.state is State.MEMBER, "frame 1 was the parent's own, heard before"
    newer = encode_radio(member((ROOT, PARENT), PARENT_AT, pulse=102)._replace(counter=9))
    lone.step(newer, encode_radio(gone._replace(counter=8)))
    assert lone.core.state is State.MEMBER
    lone.step(encode_radio(gone._replace(counter=10)))
    assert lone.core.state is State.WALKING


@pytest.mark.parametrize(("silent_steps", "believed"), [(FORGET_SENDER_STEPS, False), (FORGET_SENDER_STEPS + 1, True)])
def test_a_restarted_counter_is_believed_after_silence(silent_steps: int, believed: bool) -> None:
    """A sender that begins anew is heard again after more than 20 steps."""
    lone = Lone(at=OUTSIDE)
    lone.step(encode_radio(attending(PARENT, PARENT_AT, 1, PARENT_AT)._replace(counter=500)))
    lone.steps(silent_steps - 1)
    lone.step(encode_radio(member((PARENT,), PARENT_AT)), at=INSIDE)
    assert (lone.path != ()) == believed


def test_an_agents_own_frames_mean_nothing_to_it() -> None:
    """An echo makes no neighbour."""
    lone = Lone(at=OUTSIDE)
    lone.step()
    lone.step(attending(ME, PARENT_AT, 1, PARENT_AT), member((ME,), PARENT_AT), at=INSIDE)
    assert lone.core.state is State.WALKING


BEGINNINGS = {
    "free": lambda: Lone(mode="hybrid", delta=2),
    "decentralised": lambda: Lone(mode="decentralised"),
    "hierarchical": lambda: Lone(mode="hierarchical"),
    "member": a_member,
    "root": a_root,
}
beginnings = st.sampled_from(sorted(BEGINNINGS))


@given(lives(near_frames()), beginnings, st.randoms(use_true_random=False))
@settings(max_examples=100)
def test_the_order_of_arrival_does_not_matter(life: list[Any], begin: str, order: random.Random) -> None:
    """Shuffled, every frame twice: the same decisions."""
    one, other = BEGINNINGS[begin](), BEGINNINGS[begin]()
    for heard, sensed in life:
        frames = list({(frame.sender, frame.counter): encode_radio(frame) for frame in heard}.values())
        shuffled = order.sample(frames * 2, len(frames) * 2)
        assert one.go_where_it_wants(*frames, events=sensed) == other.go_where_it_wants(*shuffled, events=sensed)


def test_senders_are_taken_in_the_order_of_their_ids() -> None:
    """So tables, and with them bytes on the air, do not depend on arrival either."""
    children = [child(number, (ME,), (50, 50 + number)) for number in (2, 4, 8)]
    one, other = a_root(), a_root()
    decision = one.step(*children)
    assert decision == other.step(*reversed(children))
    assert isinstance(decision.radio, Member)
    assert [row.agent for row in decision.radio.table] == [2, 4, 8]


@given(lives(strange(RADIO) | near_frames().map(encode_radio), steps=6), beginnings)
@settings(max_examples=80)
def test_malformed_frames_are_counted_and_harmless(life: list[Any], begin: str) -> None:
    """An agent that hears them among others decides as one that does not hear them."""
    one, other = BEGINNINGS[begin](), BEGINNINGS[begin]()
    malformed = 0
    for heard, sensed in life:
        valid = [data for data in heard if complaint(RADIO, data) is None]
        malformed += len(heard) - len(valid)
        assert one.step(*heard, events=sensed) == other.step(*valid, events=sensed)
    assert (one.core.rejected_frames, other.core.rejected_frames) == (malformed, 0)


def assert_sound(decision: Decision, sensed: list[Event]) -> None:
    """Sendable as it is, finite and within the speed limit; only what is sensed is observed."""
    assert math.hypot(decision.act.vx_mps, decision.act.vy_mps) <= 1.0 + 1e-9
    assert set(decision.act.observed) <= {event.event for event in sensed}
    assert decode_act(encode_act(decision.act)) == decision.act
    if decision.radio is not None:
        assert decode_radio(encode_radio(decision.radio)) == decision.radio
    if decision.report is not None:
        assert decode_report(encode_report(decision.report)) == decision.report


@given(lives(radio_frames | near_frames(far_cm)), beginnings, in_arena, in_arena)
@settings(max_examples=120)
def test_no_valid_frame_of_a_stranger_upsets_an_agent(life: list[Any], begin: str, x_m: float, y_m: float) -> None:
    """Whatever places, paths, ages and orders it claims, and wherever the agent is."""
    lone = BEGINNINGS[begin]()
    home = lone.at
    for number, (heard, sensed) in enumerate(life):
        assert_sound(lone.step(*map(encode_radio, heard), events=sensed, at=home if number % 3 else (x_m, y_m)), sensed)


@given(lives(near_frames(st.integers(0, 10_000)), steps=25), beginnings)
@settings(max_examples=60)
def test_an_agent_stays_in_the_arena(life: list[Any], begin: str) -> None:
    """Wherever it is sent and lured within it; its own legs end at the walls."""
    lone = BEGINNINGS[begin]()
    lone.at = (98.5, 1.0)
    for heard, sensed in life:
        lone.go_where_it_wants(*heard, events=sensed)
        assert -1e-9 <= lone.at[0] <= 100 + 1e-9
        assert -1e-9 <= lone.at[1] <= 100 + 1e-9


def test_what_a_root_was_told_can_be_reported() -> None:
    """A report is valid, whatever sighting a member of the tree claims."""
    decision = a_root().step(child(2, (ME,), (58, 50), events=[Sighting(9, MAX_ABS_CM, 5000, 0)]))
    assert_sound(decision, [])


def test_no_place_outside_the_arena_is_gone_to() -> None:
    """Events occur within it, so such a frame is wrong."""
    lone = Lone(at=OUTSIDE)
    lone.step()
    lone.step(attending(PARENT, PARENT_AT, 4, (500, 50)), at=INSIDE)
    assert lone.core.state is State.WALKING


def test_no_order_leads_outside_the_arena() -> None:
    """Places to go to are within it, so such an order is wrong."""
    lone = a_member()
    lone.step(member((ROOT, PARENT), PARENT_AT, pulse=101, order=RecruitmentOrder(ME, 50_000, 5000, 1, 12)))
    assert lone.core.state is State.MEMBER
