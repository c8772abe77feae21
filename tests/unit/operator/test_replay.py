"""A run once more: any time of it is as it was when the run was played straight."""

import json
import math
from functools import cache
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_operator.core import replay as module
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.replay import RecordedStep, Replay
from deltaswarm_operator.io.replaying import read
from deltaswarm_wire.operator_messages import Clock
from tests.support.commanding import script
from tests.support.cores import swarm
from tests.support.tiers import in_one_test

STEPS = 260
JUDGED = ((20, "decoy"), (30, "target"), (40, "decoy"))
SETS = (
    "control.delta=2",
    "uplink.latency_s=3",
    "uplink.jitter_s=9",
    "run.duration_s=260",
    "operator.threshold_hz=1",
    "operator.person.policy=threshold",
    "operator.person.delta_limit=1",
    script([5, "set delta", "all", [], {"delta": 1}], [90, "hold", "circle", [20, 20, 9], {"for_s": 20}]),
)


@cache
def recorded() -> tuple[Any, list[RecordedStep]]:
    """A commanded run, as it reached its operator."""
    played = swarm("smoke", *SETS)
    assert played.console is not None
    steps = []
    for record, workload in played.steps(STEPS - 1):
        clock = Clock(record.step, record.time_s, record.step == STEPS - 1)
        steps.append(RecordedStep(clock, workload, played.operator.reports_of_closed_step))
    assert sum(len(step.reports) for step in steps) > 100
    return played.console.briefing, steps


def a_replay() -> Replay:
    return Replay(*recorded())


def seen(console: Console) -> tuple[Any, ...]:
    """What a console knows."""
    picture = console.picture
    known = picture.rows(), picture.inbox, set(range(len(picture.inbox))) - console.ledger.read_s.keys(), picture.now_s
    return *known, console.command_log.rows(picture.now_s), console._messages, list(console.history)


@cache
def straight(time_s: int) -> tuple[Any, ...]:
    """What the operator knew at a time of the run itself."""
    briefing, steps = recorded()
    console = Console(briefing)
    for step in steps[: time_s + 1]:
        console.close_step(*step[:3], 0.0)
    return seen(console)


@given(st.lists(st.integers(0, STEPS - 1) | st.floats(-50, STEPS + 50), min_size=1, max_size=6))
def test_a_jump_shows_what_the_run_had_shown(times_s: list[float]) -> None:
    """Back and forth, beyond the ends, and between the consoles that are kept."""
    kept = module.KEPT_EVERY_STEPS
    module.KEPT_EVERY_STEPS = 37
    try:
        replay = a_replay()
        for time_s in times_s:
            replay.seek(time_s)
            replay.show()
            assert seen(replay._console) == straight(int(min(max(math.floor(time_s), 0), STEPS - 1)))
    finally:
        module.KEPT_EVERY_STEPS = kept


def test_items_are_read_when_they_were_read_in_the_run() -> None:
    """Those of the recording and those that the simulated person reads; the page is told, and a jump back undoes it."""
    briefing, steps = recorded()
    at, unread = next((time_s, straight(time_s)[2]) for time_s in range(60, STEPS) if straight(time_s)[2])
    replay = Replay(briefing, [*steps[:at], steps[at]._replace(read=tuple(unread)), *steps[at + 1 :]])
    told: set[int] = set()
    for time_s in (at - 1, at):
        replay.seek(time_s)
        told.update(*(message["items"] for message in replay.newly_read()))
        assert told == replay._console.ledger.read_s.keys()
    assert told >= unread
    assert replay.newly_read() == []
    replay.seek(20)
    replay.seek(at - 1)
    told = {item for message in replay.newly_read() for item in message["items"]}
    assert not unread & told


def test_time_passes_at_the_speed_that_is_asked_for() -> None:
    """And stands still in a pause; a step goes on by one, or back."""
    replay = a_replay()
    replay.tick(100.0)
    replay.intend(b'{"type":"pace","speed":4}')
    replay.tick(110.0)
    assert replay.show()["time_s"] == 40
    replay.intend(b'{"type":"pace","paused":true}')
    replay.tick(150.0)
    picture = replay.show()
    assert (picture["time_s"], picture["replay"]["paused"], picture["pace"]["paused"]) == (40, True, True)
    replay.intend(b'{"type":"pace","steps":1}')
    assert replay.show()["time_s"] == 41
    replay.intend(b'{"type":"pace","steps":-11}')
    assert replay.show()["time_s"] == 30
    replay.intend(b'{"type":"pace","paused":false}')
    replay.intend(b'{"type":"seek","time_s":9999}')
    assert replay.show()["time_s"] == STEPS - 1


def test_time_passes_backwards() -> None:
    """At each moment the page sees what was known then, and the beginning is the end."""
    replay = a_replay()
    assert min(replay.hello("run")["speeds"]) < 0
    replay.seek(200)
    replay.intend(b'{"type":"pace","speed":-5}')
    for wall_s in range(30):
        replay.tick(wall_s)
        assert seen(replay._console) == straight(max(200 - 5 * wall_s, 0))


HARM = [
    {"type": "seek", "time_s": math.nan},
    {"type": "seek", "time_s": 10**400},
    {"type": "pace", "speed": math.inf},
    {"type": "pace", "speed": math.nan},
    {"type": "pace", "steps": math.inf},
    {"type": "pace", "steps": 10**400},
    {"type": "pace"},
    {"type": "read", "items": [math.inf]},
    {"type": []},
    [],
    "seek",
    3,
]


@in_one_test("intent", HARM)
def test_no_intent_stops_a_replay(intent: Any) -> None:
    """It goes on, and can be shown."""
    replay = a_replay()
    replay.tick(0.0)
    replay.intend(json.dumps(intent).encode())
    replay.tick(3.0)
    assert replay.show()["time_s"] == 3


@in_one_test("kind", ["command", "isa", "tlx", "sheet", "note"])
def test_nothing_can_be_commanded_in_a_replay(kind: str) -> None:
    """Who tries is told so."""
    (answer,) = a_replay().intend(json.dumps({"type": kind, "from": 4, "id": "c"}).encode())
    assert (answer["type"], answer["to"], answer["id"]) == ("refused", 4, "c")


def test_a_file_without_steps_is_refused(tmp_path: Any) -> None:
    """As is one that is no such file."""
    for data in (b"", msgpack.packb({}), b"\xff\xff", msgpack.packb({}) + msgpack.packb(3), msgpack.packb({"x": 1})):
        file = tmp_path / "steps"
        file.write_bytes(data)
        with pytest.raises(ValueError, match=r".+"):
            read(file)


def test_a_replay_tells_what_the_person_did_and_judges_no_earlier() -> None:
    """All acts at once, for the time bar; the map has a judgement from its step on, also after a jump back."""
    briefing, steps = recorded()
    acts = [{"time_s": float(step), "kind": "judge", "event": 1, "name": answer} for step, answer in JUDGED]
    steps = [step._replace(acts=tuple(act for act in acts if act["time_s"] == step.clock.time_s)) for step in steps]
    replay = Replay(briefing, steps)
    [_, *told] = replay.intend(json.dumps({"type": "catch_up", "from": 1}).encode())
    assert [act for message in told for act in message["acts"]] == acts
    assert [message["is_first"] for message in told] == [True]
    for time_s, answer in ((260.0, "decoy"), (35.0, "target"), (9.0, None)):
        replay.seek(time_s)
        replay.show()
        assert replay._console.judgements.get(1) == answer


def test_a_replay_tells_what_orders_were_worth() -> None:
    """A line for each order that has one; without any, the page is told nothing of the kind."""
    briefing, steps = recorded()
    assert Replay(briefing, steps, {"0": "worth: completed +1"}).hello("run")["worth"] == {"0": "worth: completed +1"}
    assert "worth" not in a_replay().hello("run")
