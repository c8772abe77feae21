"""What an agent makes of what it hears: the newest of each sender, in any order, and nothing malformed."""

import math
import random
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.frames import PaperFrame, RecruitmentOrder, Sighting, decode, encode
from deltaswarm_agent.controllers.paper.states import State
from deltaswarm_wire.codec import MAX_ABS_CM, WireError
from deltaswarm_wire.envelope import Sample, decode_sample, encode_sample
from deltaswarm_wire.messages import Event, decode_act, encode_act
from deltaswarm_wire.operator_messages import decode_report, encode_report
from tests.support.cores import (
    INSIDE,
    ME,
    OUTSIDE,
    PARENT,
    PARENT_AT,
    ROOT,
    Lone,
    StepAnswer,
    a_member,
    a_root,
    attending,
    child,
    lives,
    member,
    near_frames,
    neighbours,
    on_air,
)
from tests.support.strategies import PAPER, RADIO, complaint, paper_frames, strange

in_arena = st.floats(0.0, 100.0)
far_cm = st.integers(-MAX_ABS_CM, MAX_ABS_CM)


BEGINNINGS = {
    "free": lambda: Lone(mode="hybrid", delta=2),
    "adaptive": lambda: Lone(mode="adaptive"),
    "decentralised": lambda: Lone(mode="decentralised"),
    "hierarchical": lambda: Lone(mode="hierarchical"),
    "member": a_member,
    "root": a_root,
}
beginnings = st.sampled_from(sorted(BEGINNINGS))


@given(lives(st.builds(on_air, near_frames(), st.integers(0, 60))), beginnings, st.randoms(use_true_random=False))
def test_the_order_of_arrival_does_not_matter(life: list[Any], begin: str, order: random.Random) -> None:
    one, other = BEGINNINGS[begin](), BEGINNINGS[begin]()
    for heard, sensed in life:
        samples = list({(sender, decode_sample(data).counter): (sender, data) for sender, data in heard}.values())
        shuffled = order.sample(samples * 2, len(samples) * 2)
        assert one.go_where_it_wants(*samples, events=sensed) == other.go_where_it_wants(*shuffled, events=sensed)


def is_valid(sender: int, payload: bytes) -> bool:
    try:
        decode(sender, payload)
    except WireError:
        return False
    return True


bad_samples = st.tuples(neighbours, strange(RADIO).filter(lambda data: complaint(RADIO, data) is not None))
bad_payloads = (
    st.tuples(st.integers(10, 20), strange(PAPER))
    .filter(lambda said: not is_valid(*said))
    .map(lambda said: (said[0], encode_sample(Sample(0, said[1]))))
)
"""From senders that say nothing else; of each the first is heard, the others are duplicates."""


@given(lives(bad_samples | bad_payloads | near_frames(), steps=6), beginnings)
def test_malformed_frames_are_counted_and_harmless(life: list[Any], begin: str) -> None:
    one, other = BEGINNINGS[begin](), BEGINNINGS[begin]()
    samples, senders = 0, set()
    for heard, sensed in life:
        valid = [frame for frame in heard if isinstance(frame, PaperFrame)]
        samples += sum(said[0] < 10 for said in heard) - len(valid)
        senders |= {said[0] for said in heard if said[0] >= 10}
        assert one.step(*heard, events=sensed) == other.step(*valid, events=sensed)
    assert (one.core.core.rejected_frames, one.core.controller.counts["rejected_frames"]) == (samples, len(senders))
    assert other.core.rejected_frames == 0


def assert_sound(decision: StepAnswer, sensed: list[Event]) -> None:
    """Sendable as it is, finite and within the speed limit; only what is sensed is observed."""
    assert math.hypot(decision.act.vx_mps, decision.act.vy_mps) <= 1.0 + 1e-9
    assert set(decision.act.observed) <= {event.event for event in sensed}
    assert decode_act(encode_act(decision.act)) == decision.act
    if decision.radio is not None:
        assert decode(decision.radio.sender, encode(decision.radio)) == decision.radio
    if decision.report is not None:
        assert decode_report(encode_report(decision.report)) == decision.report


@given(lives(paper_frames | near_frames(far_cm)), beginnings, in_arena, in_arena)
def test_no_valid_frame_of_a_stranger_upsets_an_agent(life: list[Any], begin: str, x_m: float, y_m: float) -> None:
    lone = BEGINNINGS[begin]()
    home = lone.at
    for number, (heard, sensed) in enumerate(life):
        assert_sound(lone.step(*heard, events=sensed, at=home if number % 3 else (x_m, y_m)), sensed)


@given(lives(near_frames(st.integers(0, 10_000)), steps=25), beginnings)
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
    lone = Lone(at=OUTSIDE)
    lone.step()
    lone.step(attending(PARENT, PARENT_AT, 4, (500, 50)), at=INSIDE)
    assert lone.core.state is State.WALKING


def test_no_order_leads_outside_the_arena() -> None:
    lone = a_member()
    lone.step(member((ROOT, PARENT), PARENT_AT, pulse=101, order=RecruitmentOrder(ME, 50_000, 5000, 1, 12)))
    assert lone.core.state is State.MEMBER
