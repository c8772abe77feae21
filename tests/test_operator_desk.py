"""The operator's desk: commands and their fate, what somebody at the station may want, a script, what is asked."""

import csv
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.commander import MAX_QUEUE, Commander
from deltaswarm_operator.deeds import DeedTables
from deltaswarm_operator.desk import Desk
from deltaswarm_wire.commands import CIRCLE, MAX_IN_TURN, Target, Turn, decode_command, decode_turn, encode_turn
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import DONE, HEARD, REFUSED, Answer, Clock, Report, Workload
from tests.commanding import FORM, GO, RIGHT, briefing

CONSENT = {"operator": {"probes": {"consent": "Please"}}}
TLX = {"operator": {"probes": {"tlx": True, "tlx_weights": True}}}


def close(desk: Desk, step: int, *reports: Report, last: bool = False, wall_s: float = 0.0) -> Turn:
    workload = Workload(step, float(step), len(reports), 0, 0.0, 0.0, 0.0, 0, 0, 0)
    return desk.close(Clock(step, float(step), last), workload, reports, wall_s)


def report(agent: int, step: int, *answers: Answer) -> Report:
    return Report(agent, step, step, "root", 1.0, 2.0, 0, (Event(step + 1, 1.0, 1.0),), (), answers)


ON_THE_PAGE = ("agents", "events", "inbox", "unread", "workload")


def say(desk: Desk, kind: Any, wall_s: float = 0.0, **intent: Any) -> list[dict[str, Any]]:
    answers = desk.intend(json.dumps({"type": kind, "from": 3, **intent}).encode(), wall_s)
    return [json.loads(answer) for answer in answers]


def shown(desk: Desk, wall_s: float = 0.0) -> dict[str, Any]:
    return dict(json.loads(desk.show(wall_s)))


def numbers(turn: Turn) -> list[int]:
    return [decode_command(signed.body).number for signed in turn.commands]


# Commander


def commander() -> Commander:
    return Commander((GO, FORM))


def test_the_fate_of_a_command_follows_from_answers_and_time() -> None:
    """Sent, heard, done or expired; a late answer takes nothing back."""
    one = commander()
    one.give("go", Target(), {}, 10.0, 50.0)

    def fate(now_s: float) -> tuple[Any, ...]:
        *_, heard, done, refused, _, state = one.rows(now_s)[0]
        return heard, done, refused, state

    assert fate(10.0) == (0, 0, 0, "sent")
    one.hear(report(1, 12, Answer(0, HEARD), Answer(7, DONE)))
    assert fate(12.0) == (1, 0, 0, "heard")
    one.hear(report(2, 13, Answer(0, REFUSED)))
    one.hear(report(1, 14, Answer(0, DONE)))
    assert fate(14.0) == (2, 1, 1, "done")
    one.hear(report(1, 12, Answer(0, HEARD)))
    assert fate(90.0) == (2, 1, 1, "done")
    one.give("go", Target(), {}, 20.0, 50.0)
    assert one.rows(71.0)[1][-1] == "expired"


def test_only_what_the_controller_accepts_is_given() -> None:
    """The refusal is for the operator, and leaves no trace."""
    one = commander()
    wrong: Sequence[tuple[str, Any]] = [("fly", {}), ("go", {"a": 1}), ("test", {**RIGHT, "whole": True}), ("test", [])]
    for name, arguments in wrong:
        with pytest.raises(ValueError, match=r".+"):
            one.give(name, Target(), arguments, 0.0)
    with pytest.raises(ValueError, match=r".+"):
        one.give("go", Target(CIRCLE, (1.0, 1.0, -1.0)), {}, 0.0)
    assert one.sent == []
    assert one.take() == ()
    assert one.give("test", Target(), RIGHT, 0.0).number == 0


def test_commands_wait_for_their_turn_in_order_and_not_without_bound() -> None:
    """Also those that are on their way to the world, which lets only so many leave in a step."""
    one = commander()
    for _ in range(MAX_QUEUE):
        one.give("go", Target(), {}, 0.0)
    with pytest.raises(ValueError, match=str(MAX_QUEUE)):
        one.give("go", Target(), {}, 0.0)
    taken = [decode_command(signed.body).number for _ in range(9) for signed in one.take()]
    assert taken == list(range(MAX_QUEUE))
    assert not one.has_room
    one.close_step()
    for _ in range(MAX_IN_TURN):
        one.give("go", Target(), {}, 0.0)
    assert not one.has_room


# A script


def at(at_s: float, **more: Any) -> dict[str, Any]:
    return {"at_s": at_s, "name": "go", **more}


def test_a_script_gives_each_command_two_steps_before_it_leaves() -> None:
    """Those of the first steps in the first turn, and of many at once so many in a turn as it holds."""
    desk = Desk(briefing(at(7.4), at(0), at(3), *[at(12)] * 20))
    given = {step: numbers(close(desk, step)) for step in range(14)}
    assert {step: count for step, count in given.items() if count} == {
        0: [0],
        1: [1],
        5: [2],
        10: [*range(3, 19)],
        11: [*range(19, 23)],
    }


def test_a_script_of_very_many_commands_at_once_is_given_bit_by_bit() -> None:
    """In their order, and none is left out."""
    desk = Desk(briefing(*[at(0)] * 300))
    given = [number for step in range(30) for number in numbers(close(desk, step))]
    assert given == list(range(300))


@pytest.mark.parametrize("killed_after", [0, 2, 3, 4, 9])
def test_another_desk_goes_on_where_one_was_killed(killed_after: int) -> None:
    """It gives the same turns, as if nothing had happened."""
    script = briefing(at(2), *[at(5)] * 40, at(9))
    one, kept = Desk(script), ""
    turns = []
    for step in range(12):
        turns.append(encode_turn(close(one, step, report(1, step, Answer(0, DONE)))))
        if step == killed_after:
            kept = json.dumps(one.state())
    other = Desk(script)
    other.go_on(killed_after, json.loads(kept))
    other.begin(0.0)
    for step in range(killed_after + 1, 12):
        assert decode_turn(encode_turn(close(other, step, report(1, step)))) == decode_turn(turns[step])
    assert [row[0] for row in other.commander.rows(12.0)] == [row[0] for row in one.commander.rows(12.0)]
    now, before = shown(other), shown(one)
    assert [now[field] for field in ON_THE_PAGE] == [before[field] for field in ON_THE_PAGE]
    assert say(other, "catch_up") == say(one, "catch_up")


def test_who_goes_on_keeps_pause_consent_and_the_times_of_questions() -> None:
    """A new desk does not ask for what was answered, nor for questions that are past."""
    one = Desk(briefing(**CONSENT))
    one.begin(0.0)
    say(one, "sheet", consent=True)
    for step in range(500):
        close(one, step, wall_s=float(step))
    say(one, "pace", paused=True)
    say(one, "pace", speed=5)
    other = Desk(briefing(**CONSENT))
    other.go_on(499, json.loads(json.dumps(one.state())))
    other.begin(0.0)
    assert other.pace == one.pace
    assert shown(other)["probe"] is None
    assert next(step for step in range(500, 700) if close(other, step) and shown(other)["probe"]) == 600


# Intents


def test_a_command_is_accepted_or_refused_with_a_reason() -> None:
    """And leaves with the next turn."""
    desk = Desk(briefing())
    circle = {"kind": "circle", "x_m": 1, "y_m": 2, "radius_m": 3}
    answer = say(desk, "command", id="c1", name="test", target=circle, arguments=RIGHT)
    assert answer == [{"type": "accepted", "to": 3, "id": "c1", "number": 0}]
    (refused,) = say(desk, "command", id="c2", name="test", target=circle, arguments={})
    assert (refused["type"], refused["to"], refused["id"]) == ("refused", 3, "c2")
    command = decode_command(desk.turn().commands[0].body)
    assert command.target == Target(CIRCLE, (1.0, 2.0, 3.0))
    assert command.arguments == RIGHT
    assert [deed.kind for deed in desk.deeds] == ["command"]


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(["all", "go", "tree", "isa", "1e999"]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["kind", "root", "x_m", "mental"]), inner)
    ),
    max_leaves=6,
)
FIELDS = ["name", "target", "arguments", "id", "speed", "steps", "paused", "all", "items", "number", "answer"]
FIELDS += ["scales", "weights", "text", "consent"]
NASTY = [{}, [1], None, "x", 10**400, -1, math.inf, math.nan, "\ud800", {"kind": "tree", "root": 10**400}]


@given(
    st.sampled_from([*Desk._intents, "seek", 3]),
    st.dictionaries(st.sampled_from(FIELDS), JSON | st.sampled_from(NASTY), max_size=4),
)
def test_no_intent_does_any_harm(kind: Any, fields: dict[str, Any]) -> None:
    """Whatever somebody sends: the desk goes on, its picture can be shown, and its turn can be sent."""
    desk = Desk(briefing(**TLX))
    close(desk, 0, report(1, 0))
    for given_fields in (fields, {"name": "go", "target": {"kind": "all"}, **fields}):
        say(desk, kind, **given_fields)
        shown(desk)
        decode_turn(encode_turn(desk.turn()))
    assert math.isfinite(desk.pace.speed)


@given(st.binary(max_size=40) | st.sampled_from([b"{", b"[]", b"3", b"null", b'{"type":[]}', b'{"type":"pace"}']))
def test_what_is_no_intent_is_counted(data: bytes) -> None:
    """And changes nothing."""
    desk = Desk(briefing())
    before = desk.pace
    desk.intend(data, 0.0)
    assert desk.rejected == 1
    assert desk.pace == before


@pytest.mark.parametrize(
    "fields",
    [{"speed": 10**400}, {"speed": "nan"}, {"speed": -1}, {"steps": math.inf}, {"steps": 0}, {"steps": 10**9}, {}],
    ids=repr,
)
def test_a_wrong_pace_is_refused(fields: dict[str, Any]) -> None:
    """The pace stays."""
    desk = Desk(briefing(speed=2.0))
    assert say(desk, "pace", **fields)[0]["type"] == "refused"
    assert (desk.pace.speed, desk.pace.hold_step) == (2.0, -1)


def test_pause_step_and_speed() -> None:
    """A pause holds the next step, a number of steps a later one."""
    desk = Desk(briefing(speed=2.0))
    close(desk, 4)
    say(desk, "pace", paused=True)
    assert desk.pace.hold_step == 5
    assert shown(desk)["pace"] == {"paused": True, "speed": 2.0}
    say(desk, "pace", steps=3)
    assert desk.pace.hold_step == 8
    say(desk, "pace", speed=0)
    assert desk.pace == (0.0, 8)
    say(desk, "pace", paused=False)
    assert desk.pace == (0.0, -1)


def test_a_page_that_comes_late_catches_up() -> None:
    """With items, what was read of them, and the rates so far."""
    desk = Desk(briefing())
    for step in range(30):
        close(desk, step, report(1, step))
        shown(desk)
    assert say(desk, "read", items=[0, 5, 5, 99]) == [{"type": "read", "items": [0, 5]}]
    assert say(desk, "read", items=[5]) == [{"type": "read", "items": []}]
    (told,) = say(desk, "catch_up")
    assert (told["to"], len(told["inbox"]), told["read"], len(told["history"])) == (3, 30, [0, 5], 30)
    assert shown(desk)["unread"] == 28
    assert len(say(desk, "read", all=True)[0]["items"]) == 28
    assert shown(desk)["unread"] == 0


def test_a_run_waits_for_consent() -> None:
    """Nothing else lets it go: neither a pause that ends, nor steps, nor a sheet without consent."""
    desk = Desk(briefing(**CONSENT))
    desk.begin(0.0)
    assert shown(desk)["probe"] == {"kind": "sheet"}
    for kind, fields in (("pace", {"paused": False}), ("pace", {"steps": 5}), ("sheet", {}), ("sheet", {"consent": 1})):
        assert say(desk, kind, **fields)[0]["type"] == "refused"
        assert desk.pace.hold_step == 0
    say(desk, "pace", speed=5)
    assert desk.pace == (5.0, 0)
    assert say(desk, "sheet", consent=True, participant="P" * 99) == []
    assert desk.pace == (5.0, -1)
    assert shown(desk)["probe"] is None
    assert say(desk, "sheet", consent=True)[0]["type"] == "refused"


def test_every_act_and_answer_is_a_row(tmp_path: Path) -> None:
    """At once on disk, whatever is in it; who goes on adds to the table."""
    desk = Desk(briefing(operator={"probes": {"isa_every_s": 1}}))
    text = 'ä, "quoted"\nline\r\n\x00'
    tables = DeedTables(tmp_path, go_on=False)
    for step in range(2):
        close(desk, step)
    say(desk, "isa", number=0, answer=2)
    say(desk, "note", text=text)
    tables.write(desk)
    with (tmp_path / "deeds.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["kind"], json.loads(row["detail"])) for row in rows] == [("isa", 2), ("note", text)]
    more = DeedTables(tmp_path, go_on=True)
    say(desk, "note", text="x" * 9999)
    more.close(desk)
    with (tmp_path / "deeds.csv").open(newline="") as stream:
        assert len(list(csv.reader(stream))) == 4
    with (tmp_path / "probes.csv").open(newline="") as stream:
        assert next(csv.DictReader(stream))["value"] == "2"
