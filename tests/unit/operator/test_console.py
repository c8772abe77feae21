"""The operator's console: commands and their fate, what somebody at the station may want, a script, what is asked."""

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core.command_log import MAX_QUEUE, CommandLog
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import page_hello
from deltaswarm_operator.core.intents import INTENTS, carry_out
from deltaswarm_operator.io.action_log import ActionLog
from deltaswarm_scenario.person_tables import CONDUCTOR
from deltaswarm_wire.commands import CIRCLE, MAX_IN_TURN, Target, Turn, decode_command, decode_turn, encode_turn
from deltaswarm_wire.messages import Event
from deltaswarm_wire.operator_messages import DONE, HEARD, REFUSED, Answer, Clock, Report, Workload
from tests.support.commanding import FORM, GO, RIGHT, briefing, taken_over
from tests.support.tiers import in_one_test

CONSENT = {"operator": {"probes": {"consent": "Please"}}}
TLX = {"operator": {"probes": {"tlx": True, "tlx_weights": True}}}


def close(console: Console, step: int, *reports: Report, last: bool = False, wall_s: float = 0.0) -> Turn:
    workload = Workload(step, float(step), len(reports), 0, 0.0, 0.0, 0.0, 0, 0, 0)
    return console.close_step(Clock(step, float(step), last), workload, reports, wall_s)


def report(agent: int, step: int, *answers: Answer) -> Report:
    return Report(agent, step, step, "root", 1.0, 2.0, 0, (Event(step + 1, 1.0, 1.0),), (), answers)


def attended(**operator: Any) -> Console:
    """A console with a person at its station, once it is started."""
    console = Console(briefing(operator=operator))
    console.attend()
    console.start(0.0)
    return console


ON_THE_PAGE = ("agents", "events", "inbox", "unread", "workload")


def say(console: Console, kind: Any, wall_s: float = 0.0, **intent: Any) -> list[dict[str, Any]]:
    return carry_out(console, json.dumps({"type": kind, "from": 3, **intent}).encode(), wall_s)


def shown(console: Console, wall_s: float = 0.0) -> dict[str, Any]:
    return dict(console.show(wall_s))


def numbers(turn: Turn) -> list[int]:
    return [decode_command(signed.body).number for signed in turn.commands]


def command_log() -> CommandLog:
    return CommandLog((GO, FORM))


def test_the_fate_of_a_command_follows_from_answers_and_time() -> None:
    """Sent, heard, done or expired; a late answer takes nothing back."""
    one = command_log()
    one.issue("go", Target(), {}, 10.0, 50.0)

    def fate(now_s: float) -> tuple[Any, ...]:
        heard, done, refused, _, state, superseded, *_ = one.rows(now_s)[0][5:]
        assert superseded == 0
        return heard, done, refused, state

    assert fate(10.0) == (0, 0, 0, "sent")
    one.hear(report(1, 12, Answer(0, HEARD), Answer(7, DONE)))
    assert fate(12.0) == (1, 0, 0, "heard")
    one.hear(report(2, 13, Answer(0, REFUSED)))
    one.hear(report(1, 14, Answer(0, DONE)))
    assert fate(14.0) == (2, 1, 1, "done")
    assert one.rows(14.0)[0][-2:] == [[2], "person"]
    one.hear(report(1, 12, Answer(0, HEARD)))
    assert fate(90.0) == (2, 1, 1, "done")
    one.issue("go", Target(), {}, 20.0, 50.0)
    assert one.rows(71.0)[1][-4] == "expired"


TASK = {"operator": {"task": {"target_share": 0.5, "goal": "Find the targets."}}}


def test_a_reported_event_is_judged_and_another_is_not() -> None:
    """The page has the goal and the judgement; a console that takes over has it too; the conductor does not judge."""
    one = Console(briefing(**TASK))
    assert page_hello(one, "run")["goal"] == "Find the targets."
    close(one, 0, report(1, 0))
    assert say(one, "judge", event=1, answer="decoy") == say(one, "judge", event=1, answer="target") == []
    for wrong in (
        {"event": 2, "answer": "target"},
        {"event": [1], "answer": "target"},
        {"event": 1, "answer": "?"},
        {},
    ):
        [refused] = say(one, "judge", **wrong)
        assert refused["type"] == "refused"
    by_conductor = json.dumps({"type": "judge", "from": 1, "event": 1, "answer": "decoy"}).encode()
    assert carry_out(one, by_conductor, 0.0, CONDUCTOR)[0]["type"] == "refused"
    other = taken_over(one)
    assert shown(one)["judged"] == shown(other)["judged"] == [[1, "target"]]
    assert [(act.kind, act.name, act.event) for act in one.actions] == [("judge", "decoy", 1), ("judge", "target", 1)]


def test_without_a_task_nothing_is_judged() -> None:
    one = Console(briefing())
    close(one, 0, report(1, 0))
    assert page_hello(one, "run")["goal"] == ""
    assert say(one, "judge", event=1, answer="target")[0]["type"] == "refused"
    assert not one.actions


def test_only_what_the_controller_accepts_is_given() -> None:
    one = command_log()
    wrong: Sequence[tuple[str, Any]] = [("fly", {}), ("go", {"a": 1}), ("test", {**RIGHT, "whole": True}), ("test", [])]
    for name, arguments in wrong:
        with pytest.raises(ValueError, match=r".+"):
            one.issue(name, Target(), arguments, 0.0)
    with pytest.raises(ValueError, match=r".+"):
        one.issue("go", Target(CIRCLE, (1.0, 1.0, -1.0)), {}, 0.0)
    assert one.sent == []
    assert one.take_unsent() == ()
    assert one.issue("test", Target(), RIGHT, 0.0).number == 0


def test_commands_wait_for_their_turn_in_order_and_not_without_bound() -> None:
    """Also those that are on their way to the world, which lets only so many leave in a step."""
    one = command_log()
    for _ in range(MAX_QUEUE):
        one.issue("go", Target(), {}, 0.0)
    with pytest.raises(ValueError, match=str(MAX_QUEUE)):
        one.issue("go", Target(), {}, 0.0)
    taken = [decode_command(signed.body).number for _ in range(9) for signed in one.take_unsent()]
    assert taken == list(range(MAX_QUEUE))
    assert not one.has_room
    one.close_step()
    for _ in range(MAX_IN_TURN):
        one.issue("go", Target(), {}, 0.0)
    assert not one.has_room


def at(at_s: float, **more: Any) -> dict[str, Any]:
    return {"at_s": at_s, "name": "go", **more}


def test_a_script_gives_each_command_two_steps_before_it_leaves() -> None:
    """Those of the first steps in the first turn, and of many at once so many in a turn as it holds."""
    console = Console(briefing(at(7.4), at(0), at(3), *[at(12)] * 20))
    given = {step: numbers(close(console, step)) for step in range(14)}
    assert {step: count for step, count in given.items() if count} == {
        0: [0],
        1: [1],
        5: [2],
        10: [*range(3, 19)],
        11: [*range(19, 23)],
    }


def test_a_script_of_very_many_commands_at_once_is_given_bit_by_bit() -> None:
    console = Console(briefing(*[at(0)] * 300))
    given = [number for step in range(30) for number in numbers(close(console, step))]
    assert given == list(range(300))


@in_one_test("killed_after", [0, 2, 3, 4, 9])
def test_another_console_goes_on_where_one_was_killed(killed_after: int) -> None:
    script = briefing(at(2), *[at(5)] * 40, at(9))
    one, other = Console(script), Console(script)
    turns = []
    for step in range(12):
        turns.append(encode_turn(close(one, step, report(1, step, Answer(0, DONE)))))
        if step == killed_after:
            other = taken_over(one)
    other.start(0.0)
    for step in range(killed_after + 1, 12):
        assert decode_turn(encode_turn(close(other, step, report(1, step)))) == decode_turn(turns[step])
    assert [row[0] for row in other.command_log.rows(12.0)] == [row[0] for row in one.command_log.rows(12.0)]
    now, before = shown(other), shown(one)
    assert [now[field] for field in ON_THE_PAGE] == [before[field] for field in ON_THE_PAGE]
    assert say(other, "catch_up") == say(one, "catch_up")


def test_who_goes_on_keeps_pause_consent_and_the_times_of_questions() -> None:
    """A new console does not ask for what was answered, nor for questions that are past."""
    one = Console(briefing(**CONSENT))
    one.attend()
    one.start(0.0)
    say(one, "sheet", consent=True)
    for step in range(500):
        close(one, step, wall_s=float(step))
    say(one, "pace", paused=True)
    say(one, "pace", speed=5)
    other = taken_over(one, has_station=True)
    other.start(0.0)
    assert other.pace == one.pace
    assert shown(other)["probe"] is None
    assert next(step for step in range(500, 700) if close(other, step) and shown(other)["probe"]) == 600


def test_a_command_is_accepted_or_refused_with_a_reason() -> None:
    console = Console(briefing())
    circle = {"kind": "circle", "x_m": 1, "y_m": 2, "radius_m": 3}
    answer = say(console, "command", id="c1", name="test", target=circle, arguments=RIGHT)
    assert answer == [{"type": "accepted", "to": 3, "id": "c1", "number": 0}, {"type": "noted", "to": 3, "id": "c1"}]
    (refused,) = say(console, "command", id="c2", name="test", target=circle, arguments={})
    assert (refused["type"], refused["to"], refused["id"]) == ("refused", 3, "c2")
    command = decode_command(console.turn().commands[0].body)
    assert command.target == Target(CIRCLE, (1.0, 2.0, 3.0))
    assert command.arguments == RIGHT
    assert [action.kind for action in console.actions] == ["command"]


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
    st.sampled_from([*INTENTS, "seek", 3]),
    st.dictionaries(st.sampled_from(FIELDS), JSON | st.sampled_from(NASTY), max_size=4),
)
def test_no_intent_does_any_harm(kind: Any, fields: dict[str, Any]) -> None:
    """Whatever somebody sends: the console goes on, its picture can be shown, and its turn can be sent."""
    console = Console(briefing(**TLX))
    close(console, 0, report(1, 0))
    for given_fields in (fields, {"name": "go", "target": {"kind": "all"}, **fields}):
        say(console, kind, **given_fields)
        shown(console)
        decode_turn(encode_turn(console.turn()))
    assert math.isfinite(console.pace.speed)


@in_one_test(
    "fields",
    [{"speed": 10**400}, {"speed": "nan"}, {"speed": -1}, {"steps": math.inf}, {"steps": 0}, {"steps": 10**9}, {}],
)
def test_a_wrong_pace_is_refused(fields: dict[str, Any]) -> None:
    console = Console(briefing(speed=2.0))
    assert say(console, "pace", **fields)[0]["type"] == "refused"
    assert (console.pace.speed, console.pace.hold_step) == (2.0, -1)


def test_pause_step_and_speed() -> None:
    """A pause holds the next step, a number of steps a later one."""
    console = Console(briefing(speed=2.0))
    close(console, 4)
    say(console, "pace", paused=True)
    assert console.pace.hold_step == 5
    assert shown(console)["pace"] == {"paused": True, "speed": 2.0}
    say(console, "pace", steps=3)
    assert console.pace.hold_step == 8
    say(console, "pace", speed=0)
    assert console.pace == (0.0, 8)
    say(console, "pace", paused=False)
    assert console.pace == (0.0, -1)


def test_a_page_that_comes_late_catches_up() -> None:
    console = Console(briefing())
    for step in range(30):
        close(console, step, report(1, step))
        shown(console)
    assert say(console, "read", items=[0, 5, 5, 99]) == [{"type": "read", "items": [0, 5]}]
    assert say(console, "read", items=[5]) == [{"type": "read", "items": []}]
    (told,) = say(console, "catch_up")
    assert (told["to"], len(told["inbox"]), told["read"], len(told["history"])) == (3, 30, [0, 5], 30)
    assert shown(console)["unread"] == 28
    assert len(say(console, "read", all=True)[0]["items"]) == 28
    assert shown(console)["unread"] == 0


def test_a_run_waits_for_consent() -> None:
    """Nothing else lets it go: neither a pause that ends, nor steps, nor a sheet without consent."""
    console = Console(briefing(**CONSENT))
    console.start(0.0)
    assert shown(console)["probe"] == {"kind": "sheet"}
    for kind, fields in (("pace", {"paused": False}), ("pace", {"steps": 5}), ("sheet", {}), ("sheet", {"consent": 1})):
        assert say(console, kind, **fields)[0]["type"] == "refused"
        assert console.pace.hold_step == 0
    say(console, "pace", speed=5)
    assert console.pace == (5.0, 0)
    assert say(console, "sheet", consent=True, participant="P" * 99) == []
    assert console.pace == (5.0, -1)
    assert shown(console)["probe"] is None
    assert say(console, "sheet", consent=True)[0]["type"] == "refused"


def test_every_act_and_answer_is_a_row(tmp_path: Path) -> None:
    """At once on disk, whatever is in it; who replaces a killed operator cuts the table back to what was saved."""
    console = Console(briefing(operator={"probes": {"isa_every_s": 1}}))
    text = 'ä, "quoted"\nline\r\n\x00'
    tables = ActionLog(tmp_path)
    for step in range(2):
        close(console, step)
    say(console, "isa", number=0, answer=2)
    say(console, "note", text=text)
    tables.write(console)
    with (tmp_path / "actions.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["kind"], row["value"], row["text"]) for row in rows] == [("isa", "2", ""), ("note", "", text)]
    sizes = tables.sizes
    say(console, "note", text="not saved")
    tables.write(console)
    more = ActionLog(tmp_path, sizes)
    say(console, "note", text="x" * 99)
    more.close(console)
    with (tmp_path / "actions.csv").open(newline="") as stream:
        assert [row["text"] for row in csv.DictReader(stream)] == ["", text, "x" * 99]
    with (tmp_path / "probes.csv").open(newline="") as stream:
        assert next(csv.DictReader(stream))["value"] == "2"


def test_a_command_that_every_agent_refuses_is_offered_as_such() -> None:
    """The page is not told in which control modes, and an order for it is not sent."""
    made = briefing(mode="decentralised")
    go, form = made.forms
    console = Console(replace(made, forms=(replace(go, refused_in=("decentralised",)), form)))
    offered = page_hello(console, "run")["commands"]
    assert [row["refused"] for row in offered] == [True, False]
    assert [row["refused_in"] for row in offered] == [[], []]
    [refusal] = say(console, "command", name="go", target={"kind": "all"})
    assert refusal["type"] == "refused"
    assert not console.command_log.sent
