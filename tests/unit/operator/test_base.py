"""The operator's base in open air: which frames leave it when; and the console's numbers after a restart."""

import json
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core import picture
from deltaswarm_operator.core.base import MAX_FRAME_BYTES, REPEAT_S, Base
from deltaswarm_operator.core.command_log import CommandLog
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import page_hello
from deltaswarm_operator.core.intents import carry_out
from deltaswarm_scenario.operator_settings import Briefing
from deltaswarm_wire.commands import (
    ALL,
    MAX_SIGNATURE_BYTES,
    MAX_TEXT,
    ArgumentForm,
    Command,
    CommandForm,
    Relayed,
    Signed,
    Target,
    decode_command,
    decode_relayed,
    encode_command,
)
from deltaswarm_wire.envelope import MAX_COMMANDS, decode_sample
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import DONE, HEARD, Answer, Report

FORMS = (CommandForm("hold", (ALL,)),)
SIGNATURE = bytes(MAX_SIGNATURE_BYTES)


def signed(number: int, life_s: float = 60.0, **arguments: str) -> Signed:
    return Signed(encode_command(Command(number, "hold", Target(), dict(arguments), life_s)), SIGNATURE)


def sent_until(base: Base, until_s: float, now_s: float = 0.0) -> list[tuple[float, int, list[Relayed]]]:
    """When which frames leave it, by their own times."""
    frames = []
    while (wait_s := base.wait_s(now_s)) is not None and now_s + wait_s <= until_s:
        now_s += wait_s
        if (data := base.frame(now_s)) is not None:
            counter, payload, items = decode_sample(data)
            assert payload is None
            frames.append((now_s, counter, [decode_relayed(item) for item in items]))
    return frames


def numbers(items: Sequence[Relayed]) -> list[int]:
    return [decode_command(item.signed.body).number for item in items]


def test_a_command_leaves_at_once_and_is_repeated_during_its_life() -> None:
    """Each time with what is left of its life, in the boards' steps."""
    base = Base(0.5, counter=100)
    assert base.wait_s(0.0) is None
    base.send([signed(3, life_s=12.0)], 1.0)
    frames = sent_until(base, 100.0, 1.0)
    assert [(at_s, counter) for at_s, counter, _ in frames] == [(1.0, 101), (1.0 + REPEAT_S, 102), (11.0, 103)]
    assert [items[0].left_steps for _, _, items in frames] == [24, 14, 4]
    assert base.wait_s(100.0) is None
    assert base.frames == 3


@given(lives_s=st.lists(st.floats(0.01, 200), min_size=1, max_size=40), step_s=st.sampled_from([0.1, 1.0, 7.0]))
def test_every_command_leaves_and_none_outlives_its_life(lives_s: list[float], step_s: float) -> None:
    """However many there are: no frame is too large, and all that live long enough have their turn."""
    base = Base(step_s)
    base.send([signed(number, life_s) for number, life_s in enumerate(lives_s)], 0.0)
    frames = sent_until(base, 300.0)
    for at_s, _, items in frames:
        assert 1 <= len(items) <= MAX_COMMANDS
        for number, item in zip(numbers(items), items, strict=True):
            assert at_s + item.left_steps * step_s <= max(lives_s[number], step_s) + 1e-6
    counters = [counter for _, counter, _ in frames]
    assert counters == sorted(set(counters))
    told = {number for _, _, items in frames for number in numbers(items)}
    assert told >= {number for number, life_s in enumerate(lives_s) if life_s >= 40 * REPEAT_S / MAX_COMMANDS + step_s}


def test_long_commands_share_the_frames() -> None:
    base = Base(1.0)
    texts = {f"a{index}": "x" * MAX_TEXT for index in range(3)}
    base.send([signed(number, **texts) for number in range(5)], 0.0)
    frames = sent_until(base, REPEAT_S)
    assert sorted(number for _, _, items in frames for number in numbers(items)) == [0, 1, 2, 3, 4]
    assert all(sum(len(item.signed.body) + 64 for item in items) <= MAX_FRAME_BYTES for _, _, items in frames)


def test_a_new_command_does_not_wait_for_the_next_round() -> None:
    base = Base(1.0)
    base.send([signed(1)], 0.0)
    assert base.frame(0.0) is not None
    assert base.frame(1.0) is None
    base.send([signed(2)], 1.0)
    [(at_s, _, items)] = sent_until(base, 1.0, 1.0)
    assert (at_s, numbers(items)) == (1.0, [2, 1])


def test_a_later_operator_numbers_higher() -> None:
    """Also two commands of the same second differ, and answers find theirs by number."""
    clock_s = iter((1_000_000.0, 1_000_000.5, 1_000_000.9, 1_000_060.0))  # it may have slept meanwhile
    first = CommandLog(FORMS, wall_s=clock_s.__next__)
    early = [first.issue("hold", Target(), {}, now_s).number for now_s in (0.0, 0.5, 0.9, 2.0)]
    later = CommandLog(FORMS, wall_s=lambda: 1_000_061.0)
    late = later.issue("hold", Target(), {}, 1.0).number
    assert early == [1_000_000, 1_000_001, 1_000_002, 1_000_060]
    assert late > early[-1]
    answers = (Answer(early[1], DONE), Answer(early[3], HEARD), Answer(17, DONE), Answer(late, DONE))
    first.hear(Report(4, 0, 0, "root", 0.0, 0.0, 0, (), (), answers))
    assert [sent.answers for sent in first.sent] == [{}, {4: DONE}, {}, {4: HEARD}]
    assert [row[0] for row in first.rows(61.0)] == [0, 1, 2, 3]


def test_in_open_air_there_is_no_pace() -> None:
    """The page is told so, and who asks for one all the same is refused."""
    console = Console(Briefing(forms=FORMS), in_air=True)
    assert page_hello(console, "field")["speeds"] == ()
    for intent in ({"paused": True}, {"steps": 1}, {"speed": 5}):
        [answer] = carry_out(console, json.dumps({"type": "pace", "from": 1, **intent}).encode(), 0.0)
        assert answer["type"] == "refused"
    assert console.pace.hold_step == -1


def test_made_up_events_do_not_fill_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture, "MAX_NUMBERS", 10)
    seen = picture.Picture(1.0)
    items = []
    for step in range(40):
        report = Report(7, step, step, "root", 0.0, 0.0, 0, (Event(1000 + step, 1.0, 2.0),))
        items += seen.update([report], float(step))
    assert seen.event_numbers == {1000 + step: step + 1 for step in range(30, 40)}
    assert [item.events for item in items] == [(number,) for number in range(1, 41)]


@pytest.mark.parametrize("kind", ["text", "number"])
def test_what_boards_do_not_accept_is_not_sent(kind: str) -> None:
    command_log = CommandLog((CommandForm("hold", (ALL,), (ArgumentForm("for", kind),)),), wall_s=lambda: 5.0)
    with pytest.raises(ValueError, match="for"):
        command_log.issue("hold", Target(), {"for": None}, 0.0)  # type: ignore[dict-item]
    assert command_log.take_unsent() == ()
