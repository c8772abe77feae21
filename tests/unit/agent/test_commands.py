"""How commands spread: an agent's relay by itself, and in its shell with what it hears and sends."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controller import Controller, Decision, OperatorReport, Percept
from deltaswarm_agent.core.agent_core import AgentCore, StepOutput
from deltaswarm_agent.core.commands import ANSWERED_S, LONGEST_INTERVAL_S, MAX_KNOWN, CommandRelay
from deltaswarm_wire.codec import MAX_RADIO_BYTES
from deltaswarm_wire.commands import (
    AGENT,
    BASE_ID,
    CIRCLE,
    PLACE,
    TREE,
    CommandForm,
    Relayed,
    Signed,
    Target,
    decode_relayed,
    encode_command,
    encode_relayed,
)
from deltaswarm_wire.envelope import MAX_COMMANDS, Sample, decode_sample, encode_sample
from deltaswarm_wire.messages import Frame, Heard
from deltaswarm_wire.operator_messages import DONE, HEARD, MAX_ANSWERS, REFUSED, Answer
from tests.support.commanding import GO, a_command, item
from tests.support.tiers import in_one_test

ME = 7


@dataclass(frozen=True)
class NoSettings:
    """No options."""


class Deaf:
    Settings: ClassVar[type[NoSettings]] = NoSettings

    def __init__(self, **decision: Any) -> None:
        self.percepts: list[Percept] = []
        self.decision = Decision(**decision)

    def step(self, percept: Percept) -> Decision:
        self.percepts.append(percept)
        return self.decision


class Obedient(Deaf):
    Commands: ClassVar[tuple[CommandForm, ...]] = (GO,)

    def step(self, percept: Percept) -> Decision:
        return super().step(percept)._replace(done=tuple(command.number for command in percept.commands))


def a_core(controller: Deaf, **more: Any) -> AgentCore:
    return AgentCore(ME, 1.0, cast(Controller, controller), **more)


def step(core: AgentCore, now: int, *heard: Heard, at: tuple[float, float] = (1.0, 1.0)) -> StepOutput:
    return core.step(Frame(now, float(now), False, *at, (), (), heard))


def told(sender: int, counter: int, *items: bytes, payload: bytes | None = None) -> Heard:
    return sender, encode_sample(Sample(counter, payload, items))


def relayed(out: StepOutput) -> list[tuple[int, int]]:
    found = [decode_relayed(data) for data in (decode_sample(out.radio).commands if out.radio else ())]
    return [(one.signed.body[3] if one.signed.body[2] == 0xCC else one.signed.body[2], one.left_steps) for one in found]


def a_relay(step_s: float = 1.0) -> CommandRelay:
    return CommandRelay(step_s, (GO,))


def sent_steps(relay: CommandRelay, first: int, until: int) -> list[int]:
    return [now for now in range(first, until) if relay.due(now, 1000)]


def test_a_command_is_taken_in_once_whoever_relays_it() -> None:
    """From the base, from another agent, later, or twice in one frame."""
    core = a_core(controller := Obedient())
    go = item(a_command(3))
    step(core, 0, told(BASE_ID, 1, go, go), told(2, 0, go), told(4, 9, go, payload=b"hello"))
    step(core, 1, told(2, 1, go))
    step(core, 300, told(BASE_ID, 2, go))
    assert [[command.number for command in percept.commands] for percept in controller.percepts] == [[3], [], []]


def test_a_frame_without_payload_tells_the_controller_nothing() -> None:
    """Nor does a frame of the base, whatever it claims to carry."""
    core = a_core(controller := Obedient())
    step(core, 0, told(2, 0, item(a_command())), told(BASE_ID, 1, item(a_command(1)), payload=b"base"))
    assert controller.percepts[0].heard == []
    step(core, 1, told(2, 1, payload=b"x"))
    assert controller.percepts[1].heard == [(2, b"x")]


def test_it_is_relayed_at_once_and_then_at_doubling_intervals() -> None:
    """Until its life is over; each frame says how much of it is left for who hears it a step later."""
    relay = a_relay()
    relay.hear([item(a_command(life_s=60), left_steps=60)], 100)
    sent = {now: decode_relayed(items[0]).left_steps for now in range(100, 400) if (items := relay.due(now, 1000))}
    assert list(sent) == [100, 102, 106, 114, 130, 146]
    assert all(now + left + 1 == 160 for now, left in sent.items())


@given(life_s=st.floats(0.1, 500), left=st.integers(0, 600), step_s=st.sampled_from([0.1, 0.5, 1.0, 7.0]))
def test_its_life_is_over_in_time(life_s: float, left: int, step_s: float) -> None:
    """Whatever the one who relays it claims, and what is not alive any more is nobody's command."""
    relay = a_relay(step_s)
    heard = relay.hear([item(a_command(life_s=life_s), left)], 10)
    assert bool(heard) == (left > 0)
    life = min(left, max(1, round(life_s / step_s)))
    sent = sent_steps(relay, 10, 10 + life + 50)
    assert all(now + 1 < 10 + life for now in sent)
    assert relay.next_step(10 + life) is None
    gaps = [after - before for before, after in pairwise(sent)]
    assert all(gap <= max(1, round(LONGEST_INTERVAL_S / step_s)) for gap in gaps)


@given(lefts=st.lists(st.integers(0, 80), min_size=1, max_size=6), gap=st.integers(0, 9))
def test_a_relay_that_shortens_a_life_silences_nobody(lefts: list[int], gap: int) -> None:
    """The longest life that is heard holds, from its first hearing at most the signed one."""
    relay, ends, latest_end = a_relay(), 0, 0
    go = a_command(life_s=60)
    for index, left in enumerate(lefts):
        now = 10 + gap * index
        heard = relay.hear([item(go, left)], now)
        latest_end = latest_end or (now + 60 if left else 0)
        end = min(now + left, latest_end) if left else 0
        assert bool(heard) == (end > ends)
        if heard:
            assert heard[0].life_s == end - now
        ends = max(ends, end)
    sent = sent_steps(relay, now, 200)
    assert all(step + 1 < ends for step in sent)
    assert not ends or ends <= now + 2 or sent


def test_a_command_whose_life_is_over_stays_so() -> None:
    """A relay with no steps left comes from where it has ended, whatever was heard of it before."""
    relay = a_relay()
    relay.hear([item(a_command(life_s=60), left_steps=5)], 100)
    assert not relay.hear([item(a_command(life_s=60), left_steps=0)], 110)
    assert not sent_steps(relay, 106, 200)


def test_a_relay_that_changed_the_signature_prolongs_nothing() -> None:
    """Only what the operator signed counts."""
    relay, command = a_relay(), a_command(life_s=60)
    relay.hear([item(command, left_steps=5)], 100)
    other = encode_relayed(Relayed(40, Signed(encode_command(command), b"another")))
    assert not relay.hear([other], 102)
    assert not sent_steps(relay, 106, 200)


def test_a_command_goes_on_when_another_is_forgotten() -> None:
    """Its state is answered, it is relayed, and a relay that says that it lives longer is believed."""
    relay = a_relay()
    relay.hear([item(a_command(0, life_s=10), 10), item(a_command(1, life_s=5000), 800)], 0)
    relay.note([1], [])
    for now in range(700):
        relay.due(now, 1000)
    assert relay.answers() == (Answer(1, DONE),)
    relay.hear([item(a_command(1, life_s=5000), 3000)], 700)
    assert sent_steps(relay, 900, 1000)


def test_what_is_done_is_relayed_on_but_not_carried_out_again() -> None:
    core = a_core(controller := Obedient())
    step(core, 0, told(2, 0, item(a_command(life_s=60), 1)))
    out = step(core, 4, told(BASE_ID, 1, item(a_command(life_s=60), 50)))
    assert [len(percept.commands) for percept in controller.percepts] == [1, 0]
    assert relayed(out) == [(0, 49)]


def test_along_a_chain_it_ends_everywhere_at_once() -> None:
    """Each hop takes a step of its life."""
    relays = [a_relay() for _ in range(12)]
    relays[0].hear([item(a_command(life_s=8), left_steps=8)], 0)
    knows = {0: 0}
    for now in range(20):
        for place in reversed(range(11)):
            items = relays[place].due(now, 1000)
            assert not items or now < 8
            if items and relays[place + 1].hear(items, now + 1):
                knows[place + 1] = now + 1
    assert knows == {place: place for place in range(8)}


def test_an_agent_that_sleeps_is_asked_when_it_has_to_relay() -> None:
    """Its act holds no longer than that; the controller's own step may be earlier."""
    core = a_core(Obedient(until=1000))
    asked, now, heard = [], 0, (told(BASE_ID, 1, item(a_command(life_s=60), 60)),)
    while now < 60:
        out = step(core, now, *heard)
        asked.append((now, bool(relayed(out))))
        now, heard = out.act.until, ()
    assert [at for at, sends in asked if sends] == [0, 2, 6, 14, 30, 46]
    assert len(asked) <= 8
    early = step(a_core(Obedient(until=1)), 0, told(BASE_ID, 1, item(a_command())))
    assert early.act.until == 1


def test_what_has_no_room_waits() -> None:
    """Eight commands in a frame, the newest first, and none beside a payload that leaves no room."""
    core = a_core(controller := Obedient())
    items = [item(a_command(number)) for number in range(12)]
    first = step(core, 0, told(BASE_ID, 1, *items[:8]), told(2, 0, *items[8:]))
    assert [number for number, _ in relayed(first)] == [*range(11, 3, -1)]
    second = step(core, 1)
    assert [number for number, _ in relayed(second)] == [3, 2, 1, 0]
    full = a_core(Obedient(payload=b"x" * (MAX_RADIO_BYTES - 40)))
    out = step(full, 0, told(BASE_ID, 1, items[0]))
    assert relayed(out) == []
    assert out.act.until == 1
    assert len(controller.percepts[0].commands) == 12
    for size in range(MAX_RADIO_BYTES - 600, MAX_RADIO_BYTES - 12, 7):
        out = step(a_core(Obedient(payload=b"x" * size)), 0, told(BASE_ID, 1, *items[:8]))
        assert out.radio is not None
        assert len(out.radio) <= MAX_RADIO_BYTES


@pytest.mark.parametrize(("controller", "state"), [(Deaf(), REFUSED), (Obedient(), DONE)], ids=["deaf", "obedient"])
def test_who_does_not_accept_a_command_relays_and_refuses_it(controller: Deaf, state: int) -> None:
    controller.decision = controller.decision._replace(report=OperatorReport(()))
    core = a_core(controller)
    out = step(core, 0, told(BASE_ID, 1, item(a_command(5))))
    assert [number for number, _ in relayed(out)] == [5]
    assert out.report is not None
    assert out.report.answers == (Answer(5, state),)
    assert [len(percept.commands) for percept in controller.percepts] == [int(state == DONE)]


@in_one_test(
    ("target", "is_meant"),
    [
        (Target(), True),
        (Target(CIRCLE, (1, 1, 0)), True),
        (Target(CIRCLE, (5, 1, 3)), False),
        (Target(AGENT, (7,)), True),
        (Target(AGENT, (6,)), False),
        (Target(TREE, (4,)), True),
        (Target(TREE, (7,)), False),
        (Target(PLACE, (99, 99)), True),
    ],
)
def test_a_command_is_for_its_target_and_is_heard_by_all(target: Target, is_meant: bool) -> None:
    controller = Obedient(root=4, parent=4, level=1, role="member", report=OperatorReport(()))
    core = a_core(controller)
    step(core, 0)
    out = step(core, 1, told(BASE_ID, 1, item(a_command(1, target=target))))
    assert bool(controller.percepts[1].commands) == is_meant
    assert relayed(out)
    assert out.report is not None
    assert out.report.answers == (Answer(1, DONE if is_meant else HEARD),)


def test_answers_are_of_the_newest_commands_and_for_a_while() -> None:
    relay = a_relay()
    for number in range(40):
        relay.hear([item(a_command(number, life_s=20))], 0)
    relay.note([39, 77], [38])
    assert [answer.command for answer in relay.answers()] == [*range(40 - MAX_ANSWERS, 40)]
    assert relay.answers()[-2:] == (Answer(38, REFUSED), Answer(39, DONE))
    relay.due(20 + int(ANSWERED_S) - 1, 0)
    assert relay.answers()
    relay.due(20 + int(ANSWERED_S), 0)
    assert relay.answers() == ()


def test_endless_new_numbers_do_not_fill_the_memory() -> None:
    """A hostile agent makes an agent forget the oldest commands, not grow; and a known one stays known."""
    relay = a_relay()
    for number in range(3 * MAX_KNOWN):
        relay.hear([item(a_command(number, life_s=80_000), 80_000)], number // MAX_COMMANDS)
    assert len(relay.known) <= MAX_KNOWN
    assert sum(map(relay.knows, range(3 * MAX_KNOWN))) <= MAX_KNOWN
    for number in (0, 5, MAX_KNOWN, 3 * MAX_KNOWN - 1):
        assert relay.hear([item(a_command(number), 10)], 5000) == []


def test_what_is_no_command_is_counted_and_dropped() -> None:
    """Also one that the operator has not signed, which may come signed later."""
    relay = CommandRelay(1.0, (GO,), lambda signed: signed.signature == b"mine")
    assert relay.hear([b"", b"\xff", item(a_command())[:-1], item(a_command())], 0) == []
    assert relay.rejected == 4
    assert relay.due(0, 1000) == ()


@given(st.lists(st.lists(st.binary(max_size=60) | st.sampled_from([item(a_command(n)) for n in range(9)]), max_size=8)))
def test_whatever_is_relayed_does_no_harm(life: list[list[bytes]]) -> None:
    core = a_core(Obedient(payload=b"x" * 8000))
    for now, items in enumerate(life):
        out = step(core, now, told(2, now, *items, payload=b""))
        assert out.radio is not None
        assert out.act.until > now
