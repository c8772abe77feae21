"""An agent around its controller: it hears, numbers and encodes, and lets no bad decision out."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controller import Controller, ControllerError, Decision, OperatorReport, Percept
from deltaswarm_agent.core.agent_core import FORGET_SENDER_S, AgentCore, Receiver, StepOutput
from deltaswarm_wire.codec import MAX_AGENT_ID, MAX_ID, MAX_RADIO_BYTES
from deltaswarm_wire.envelope import Sample, decode_sample, encode_sample
from deltaswarm_wire.messages import (
    FREE,
    MAX_DELTA,
    MAX_POSES,
    MAX_ROLE,
    MAX_SENSED,
    MAX_SPEED_MPS,
    Event,
    Frame,
    Heard,
    TreeStatus,
    decode_act,
)
from deltaswarm_wire.operator_messages import MAX_REPORTED, Report, decode_report
from tests.support.tiers import in_one_test

ME = 7


@dataclass(frozen=True)
class NoSettings:
    """A scripted controller has no options."""


class Scripted:
    Settings: ClassVar[type[NoSettings]] = NoSettings

    def __init__(self, *decisions: Any) -> None:
        self._decisions = list(decisions)
        self.percepts: list[Percept] = []

    def step(self, percept: Percept) -> Decision:
        self.percepts.append(percept)
        found = self._decisions.pop(0)
        if isinstance(found, BaseException):
            raise found
        return cast(Decision, found)


def core_of(*decisions: Any) -> tuple[AgentCore, Scripted]:
    controller = Scripted(*decisions)
    return AgentCore(ME, 1.0, cast(Controller, controller)), controller


def frame(step: int, *heard: Heard, events: tuple[Event, ...] = ()) -> Frame:
    return Frame(step, float(step), False, 1.5, 2.5, ((1.0, 2.0),), events, heard)


def sample(sender: int, counter: int, payload: bytes = b"hello") -> Heard:
    return sender, encode_sample(Sample(counter, payload))


def outbound(decision: Decision, step: int = 3) -> StepOutput:
    return core_of(decision)[0].step(frame(step))


def test_a_controller_is_told_what_is_sensed_and_heard() -> None:
    """Step, time, pose, the poses since, events, and payloads without their envelopes; an echo is no neighbour."""
    core, controller = core_of(Decision())
    near = Event(4, 2.0, 2.0)
    core.step(frame(3, sample(5, 0, b"five"), sample(2, 9, b"two"), sample(ME, 0), events=(near,)))
    assert controller.percepts == [Percept(3, 3.0, (1.5, 2.5), ((1.0, 2.0),), (near,), [(2, b"two"), (5, b"five")])]


def test_a_decision_becomes_an_act() -> None:
    decision = Decision((0.5, -0.25), (4,), None, None, "guide", 2, 3, 1, 9)
    out = outbound(decision)
    assert out.act == decode_act(out.act_bytes)
    assert (out.act.step, out.act.vx_mps, out.act.vy_mps, out.act.observed) == (3, 0.5, -0.25, (4,))
    assert (out.act.tree_status, out.act.until) == (TreeStatus("guide", 2, 3, 1), 9)
    assert (out.radio, out.report, out.report_bytes) == (None, None, None)


def test_a_controller_that_says_nothing_of_itself_is_free() -> None:
    """It stands, observes and sends nothing, and is asked again in the next step."""
    act = outbound(Decision()).act
    assert (act.vx_mps, act.vy_mps, act.observed, act.tree_status) == (0.0, 0.0, (), TreeStatus(FREE))
    assert act.until == 4


def test_an_agent_is_asked_at_least_each_64_steps() -> None:
    """A later `until` is brought forward: a frame holds no more poses than that."""
    assert outbound(Decision(until=3 + MAX_POSES)).act.until == 3 + MAX_POSES
    assert outbound(Decision(until=10**9)).act.until == 3 + MAX_POSES
    assert outbound(Decision(until=cast(Any, math.inf))).act.until == 3 + MAX_POSES


def test_radio_frames_are_counted_from_0() -> None:
    """One up with each that is sent, not with each step."""
    core, _ = core_of(Decision(payload=b"a"), Decision(), Decision(payload=b""), Decision(payload=b"c"))
    outs = [core.step(frame(step)) for step in range(4)]
    sent = [(out.counter, decode_sample(out.radio)) for out in outs if out.radio is not None]
    assert sent == [(0, Sample(0, b"a")), (1, Sample(1, b"")), (2, Sample(2, b"c"))]


def test_reports_are_numbered_from_0() -> None:
    """With the agent, the step, its place and its role."""
    event = Event(4, 2.0, 2.0)
    told = OperatorReport((event,), 5)
    core, _ = core_of(Decision(), Decision(report=told, role="root"), Decision(report=told, role="root"))
    reports = [core.step(frame(step)).report for step in range(3)]
    assert reports == [None, *(Report(ME, n, n + 1, "root", 1.5, 2.5, 5, (event,)) for n in (0, 1))]


def test_a_report_carries_at_most_64_events() -> None:
    """It carries the first of those that the controller names; the others are counted."""
    events = tuple(Event(number, 0.0, 0.0) for number in range(MAX_REPORTED + 5))
    core, _ = core_of(Decision(report=OperatorReport(events)))
    out = core.step(frame(0))
    assert core.rows_cut == 5
    assert "report_rows_cut 5" in core.counts
    assert out.report is not None
    assert out.report.events == events[:MAX_REPORTED]
    assert out.report_bytes is not None
    assert decode_report(out.report_bytes) == out.report


def test_a_report_is_what_its_bytes_say() -> None:
    """In one process the operator gets the object, else the bytes: both must hold the same."""
    out = outbound(Decision(report=OperatorReport(cast(Any, [(1, 2, 0)]))))
    assert out.report is not None
    assert out.report.events == (Event(1, 2.0, 0.0),)
    assert type(out.report.events[0]) is Event


BAD = {
    "not a number": Decision((math.nan, 0.0)),
    "not finite": Decision((0.0, math.inf)),
    "too fast": Decision((MAX_SPEED_MPS * 1.001, 0.0)),
    "velocity of text": Decision(cast(Any, ("fast", 0.0))),
    "velocity of one": Decision(cast(Any, (1.0,))),
    "velocity of nothing": Decision(cast(Any, None)),
    "payload of text": Decision(payload=cast(Any, "text")),
    "payload of a list": Decision(payload=cast(Any, [1])),
    "payload too long": Decision(payload=bytes(MAX_RADIO_BYTES)),
    "until now": Decision(until=3),
    "until before": Decision(until=-1),
    "until within this step": Decision(until=cast(Any, 3.5)),
    "until never": Decision(until=cast(Any, math.nan)),
    "until of text": Decision(until=cast(Any, "soon")),
    "role empty": Decision(role=""),
    "role too long": Decision(role="x" * (MAX_ROLE + 1)),
    "role of bytes": Decision(role=cast(Any, b"root")),
    "role of another alphabet": Decision(role="räuber"),
    "role of two lines": Decision(role="root\n"),
    "no event": Decision(observed=(-1,)),
    "no such event": Decision(observed=(MAX_ID + 1,)),
    "event of text": Decision(observed=cast(Any, ("4",))),
    "events of nothing": Decision(observed=cast(Any, None)),
    "too many events": Decision(observed=tuple(range(MAX_SENSED + 1))),
    "level below 0": Decision(level=-1),
    "parent of none": Decision(parent=-2),
    "root of none": Decision(root=MAX_AGENT_ID + 1),
    "report of text": Decision(report=cast(Any, "all is well")),
    "report of followers below 0": Decision(report=OperatorReport((), -1)),
    "report of no place": Decision(report=OperatorReport((Event(1, math.nan, 0.0),))),
    "report of no event": Decision(report=OperatorReport(cast(Any, (5,)))),
    "nothing": None,
    "a tuple": tuple(Decision()),
    "its velocity": (1.0, 0.0),
    "error": ValueError("I am\nlost"),
    "assertion": AssertionError(),
    "exit": SystemExit(0),
    "events as a generator": Decision(observed=cast(Any, (event for event in (1,)))),
    "level of a share": Decision(level=cast(Any, 1.5)),
    "level of truth": Decision(level=True),
    "report of nothing": Decision(report=OperatorReport(cast(Any, None))),
}


SAID = {
    "not a number": "(got nan, 0.0)",
    "payload of text": "payload must",
    "payload too long": f"at most {MAX_RADIO_BYTES}",
    "until now": "until must",
    "no event": "(got (-1,))",
    "role empty": "role must",
    "velocity of text": "(got ('fast', 0.0))",
    "until of text": "until must",
    "events of nothing": "observed must",
    "level of a share": "(got 1.5, -1, -1, 0)",
    "report of nothing": "report.events must",
    "exit": "SystemExit: 0",
    "nothing": "Decision (got NoneType)",
    "error": "ValueError: I am lost",
}
"""What must hold, and what was got, of some."""


@in_one_test("bad", BAD)
def test_a_bad_decision_is_one_line_with_controller_and_step(bad: str) -> None:
    """Whatever a controller returns or raises: the agent has failed, and the text says why and where to look."""
    core, _ = core_of(BAD[bad])
    with pytest.raises(ControllerError) as caught:
        core.step(frame(3))
    text = str(caught.value)
    assert SAID.get(bad, "") in text
    assert f"{__name__}:Scripted" in text
    assert "step 3" in text
    assert len(text.splitlines()) == 1


def test_an_interrupt_is_not_a_controllers_failure() -> None:
    with pytest.raises(KeyboardInterrupt):
        core_of(KeyboardInterrupt())[0].step(frame(3))


finite = st.floats(-MAX_SPEED_MPS, MAX_SPEED_MPS)
agents = st.integers(0, MAX_AGENT_ID)
decisions = st.builds(
    Decision,
    st.tuples(finite, finite),
    st.lists(st.integers(0, MAX_ID), max_size=4).map(tuple),
    st.none() | st.binary(max_size=40),
    st.none(),
    st.sampled_from(["free", "root", "a role of mine"]),
    agents,
    agents | st.just(-1),
    agents | st.just(-1),
    st.none() | st.integers(4, 10**6),
    delta=st.integers(0, MAX_DELTA),
)


@given(decisions)
def test_every_good_decision_is_sent_as_it_is(decision: Decision) -> None:
    out = outbound(decision)
    assert decode_act(out.act_bytes) == out.act
    assert ((out.act.vx_mps, out.act.vy_mps), out.act.observed) == (decision.velocity, decision.observed)
    assert out.act.tree_status == TreeStatus(
        decision.role, decision.level, decision.parent, decision.root, decision.delta
    )
    assert (out.radio and decode_sample(out.radio).payload) == decision.payload


def test_of_each_sender_the_newest_counts() -> None:
    """By its counter, in whatever order frames come; senders in order of their ids."""
    receiver = Receiver(ME, 1.0)
    heard = [sample(5, 3, b"old"), sample(9, 0, b"nine"), sample(5, 4, b"new"), sample(5, 2, b"older")]
    assert receiver.newest_of(heard, 0)[0] == [(5, b"new"), (9, b"nine")]
    assert Receiver(ME, 1.0).newest_of(heard[::-1], 0)[0] == [(5, b"new"), (9, b"nine")]


def test_late_and_duplicate_frames_are_dropped() -> None:
    """Not newer than what was heard in an earlier step, or in this one."""
    receiver = Receiver(ME, 1.0)
    assert receiver.newest_of([sample(5, 3), sample(5, 3, b"twin")], 0)[0] == [(5, b"hello")]
    assert receiver.newest_of([sample(5, 3), sample(5, 1)], 1)[0] == []
    assert receiver.newest_of([sample(5, 4, b"next")], 2)[0] == [(5, b"next")]
    assert receiver.rejected == 0


def test_own_frames_are_dropped() -> None:
    assert Receiver(ME, 1.0).newest_of([sample(ME, 0), sample(8, 0)], 0)[0] == [(8, b"hello")]


@in_one_test("data", [b"", b"\xc1", b"\x93\x01\x00\xc4\x00", b"\x93\x03\x00\xa0", bytes(MAX_RADIO_BYTES + 1)])
def test_malformed_frames_are_counted_and_dropped(data: bytes) -> None:
    """Not MessagePack, another version, a payload that is not bytes, too long: the others are heard."""
    core, controller = core_of(Decision())
    core.step(frame(0, (4, data), sample(5, 0)))
    assert controller.percepts[0].heard == [(5, b"hello")]
    assert core.rejected_frames == 1


def test_a_malformed_frame_does_not_hide_its_senders_good_one() -> None:
    receiver = Receiver(ME, 1.0)
    assert receiver.newest_of([(5, b"\xc1"), sample(5, 0), (5, b"")], 0)[0] == [(5, b"hello")]
    assert receiver.rejected == 2


@pytest.mark.parametrize("step_s", [0.25, 1.0, 5.0])
def test_a_counter_may_begin_anew_after_20_s_of_silence(step_s: float) -> None:
    silence = round(FORGET_SENDER_S / step_s)
    for waited, believed in ((silence, False), (silence + 1, True)):
        receiver = Receiver(ME, step_s)
        assert receiver.newest_of([sample(5, 500)], 10)[0]
        assert bool(receiver.newest_of([sample(5, 0)], 10 + waited)[0]) == believed
