"""The downlink and the operator's turns, without agents and in a world."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from deltaswarm_wire.commands import BASE_ID, MAX_IN_TURN, Turn, decode_command, decode_relayed
from deltaswarm_wire.envelope import MAX_COMMANDS, decode_sample
from deltaswarm_wire.messages import FRAME_ROOM_BYTES, MAX_POSES, decode_frame, encode_frame
from deltaswarm_world.core.downlink import Downlink
from deltaswarm_world.core.turns import AWAITED, LIVE, MAX_WAITING, OFF, Turns
from tests.support.commanding import a_command, sign
from tests.support.tiers import in_one_test
from tests.support.worlds import Stage

PLACES = np.array([[0.0, 0.0], [3.0, 4.0], [30.0, 40.0]])


class Base:
    def __init__(self, step_s: float = 1.0, **downlink: Any) -> None:
        table = {"run": {"step_s": step_s}, "agents": {"count": 3}, "downlink": {"base_m": [0, 0], **downlink}}
        self.downlink = Downlink(load(Scenario, table))
        self.step_s = step_s
        self.heard: dict[int, list[int]] = {0: [], 1: [], 2: []}
        """The steps in which each agent heard something."""
        self.numbers: dict[int, set[int]] = {0: set(), 1: set(), 2: set()}
        self.ends: set[int] = set()
        """The steps with which lives end, as agents heard."""

    def play(self, steps: range, listening: Sequence[bool] = (True,) * 3) -> None:
        for step in steps:
            heard = self.downlink.carry(step, step * self.step_s, PLACES, listening)
            assert heard == sorted(heard, key=lambda one: one[0])
            assert len({agent for agent, _ in heard}) == len(heard)
            for agent, data in heard:
                self.heard[agent].append(step)
                assert len(data) < 848
                for item in decode_sample(data).commands:
                    relayed = decode_relayed(item)
                    self.numbers[agent].add(decode_command(relayed.signed.body).number)
                    self.ends.add(step + relayed.left_steps)

    def assert_books_close(self) -> None:
        """Every frame of the base is heard, dropped or under way at each agent."""
        totals = self.downlink.totals
        assert 3 * totals["frames_sent"] == (
            totals["frames_heard"] + totals["in_flight"] + sum(totals["dropped"].values())
        )


@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_the_base_repeats_a_command_until_its_life_is_over(step_s: float) -> None:
    """At once, and then every `repeat_s`; in between and before it is silent."""
    base = Base(step_s, repeat_s=4)
    base.play(range(5))
    base.downlink.send(5, [sign(a_command(life_s=10))])
    base.play(range(5, 40))
    assert base.heard == {agent: [5 + round(after_s / step_s) for after_s in (0, 4, 8)] for agent in range(3)}
    assert base.ends == {5 + round(10 / step_s)}
    base.assert_books_close()


def test_only_agents_in_range_hear_it() -> None:
    base = Base(range_m=5)
    base.downlink.send(0, [sign(a_command())])
    base.play(range(3))
    assert [len(base.heard[agent]) for agent in range(3)] == [1, 1, 0]
    assert base.downlink.totals["dropped"] == {"range": 1}
    base.assert_books_close()


@pytest.mark.parametrize("step_s", [0.5, 1.0])
def test_outages_and_deaf_agents_are_told_apart(step_s: float) -> None:
    """A frame in an outage reaches nobody; one at an agent that does not listen is dropped there."""
    base = Base(step_s, repeat_s=1, outages=[{"from_s": 2, "until_s": 4}])
    base.downlink.send(0, [sign(a_command())])
    base.play(range(round(6 / step_s)), (True, False, True))
    heard = [round(at_s / step_s) for at_s in (0, 1, 4, 5)]
    assert base.heard == {0: heard, 1: [], 2: heard}
    assert base.downlink.totals["dropped"] == {"outage": 6, "dead": 4}
    base.assert_books_close()


def test_the_share_that_is_lost_is_as_asked_for() -> None:
    base = Base(repeat_s=1, loss=0.3)
    base.downlink.send(0, [sign(a_command(life_s=4000))])
    base.play(range(4000))
    for steps in base.heard.values():
        assert len(steps) / 4000 == pytest.approx(0.7, abs=0.03)
    assert base.heard[0] != base.heard[1]
    base.assert_books_close()


@given(
    latency_s=st.floats(0, 9),
    jitter_s=st.floats(0, 9),
    repeat_s=st.integers(1, 6),
    count=st.integers(1, 12),
    loss=st.sampled_from([0.0, 0.5, 1.0]),
)
def test_what_is_delayed_arrives_in_its_time(
    latency_s: float, jitter_s: float, repeat_s: int, count: int, loss: float
) -> None:
    """Not earlier, and a frame at a time for each agent; the books close at any moment."""
    base = Base(latency_s=latency_s, jitter_s=jitter_s, repeat_s=repeat_s, loss=loss)
    base.downlink.send(10, [sign(a_command(number)) for number in range(count)])
    for step in range(10, 70):
        base.play(range(step, step + 1))
        base.assert_books_close()
    assert base.downlink.totals["in_flight"] == 0
    for steps in base.heard.values():
        assert all(10 + math.floor(latency_s) <= step <= 30 + math.ceil(latency_s + jitter_s) for step in steps)
        assert loss == 1 or loss == 0.5 or steps


@in_one_test("count", [1, MAX_COMMANDS, MAX_COMMANDS + 1, 40])
def test_no_command_starves_behind_newer_ones(count: int) -> None:
    """Of more than fit into a frame the others follow in the next steps, and all are repeated in turn."""
    base = Base(repeat_s=2)
    base.downlink.send(0, [sign(a_command(number, life_s=60)) for number in range(count)])
    base.play(range(math.ceil(count / MAX_COMMANDS)))
    assert base.numbers[0] == set(range(count))
    base.numbers[0].clear()
    base.play(range(math.ceil(count / MAX_COMMANDS), 59))
    assert base.numbers[0] == set(range(count))


def test_a_large_command_does_not_keep_others_back() -> None:
    """Frames stay small, whatever the commands are."""
    base = Base(repeat_s=5)
    base.downlink.send(0, [sign(a_command(number, name="n" * 64)) for number in range(30)])
    base.play(range(10))
    assert base.numbers[0] == set(range(30))


def test_without_commands_there_is_no_frame_and_no_draw() -> None:
    """So the digest of such a run is as it was."""
    quiet, fresh = Base(loss=0.5, jitter_s=3, repeat_s=1), Base(loss=0.5, jitter_s=3, repeat_s=1)
    quiet.play(range(50))
    assert quiet.downlink.totals == {"frames_sent": 0, "frames_heard": 0, "in_flight": 0, "dropped": {}}
    for base in (quiet, fresh):
        base.downlink.send(50, [sign(a_command())])
        base.play(range(50, 100))
    assert quiet.heard == fresh.heard != {0: [], 1: [], 2: []}


def leaving(turns: Turns, step: int) -> list[int]:
    return [decode_command(signed.body).number for signed in turns.leaving(step, 0.5)]


def a_turn(step: int, *numbers: int) -> Turn:
    return Turn(step, tuple([sign(a_command(number)) for number in numbers]))


def test_a_step_begins_with_the_turn_of_the_step_before_the_last() -> None:
    """The first two need none; a command leaves two steps after the one that it answers."""
    turns = Turns(AWAITED)
    assert [turns.is_due(step) for step in range(4)] == [True, True, False, False]
    assert turns.accept(a_turn(0, 7)) is None
    assert turns.is_due(2)
    assert not turns.is_due(3)
    assert [leaving(turns, step) for step in range(4)] == [[], [], [7], []]
    assert [entry["at_s"] for entry in turns.log] == [1.0]


def test_a_turn_that_comes_again_is_passed_over() -> None:
    """As from an operator that stands in for one that was killed."""
    turns = Turns(AWAITED)
    for step in (0, 1, 0, 1, 1):
        turns.accept(a_turn(step, step))
    assert [leaving(turns, step) for step in range(5)] == [[], [], [0], [1], []]


def test_a_person_is_not_awaited() -> None:
    """What it says leaves in the step that begins next, though never before a script could have said it."""
    turns = Turns(LIVE)
    assert all(turns.is_due(step) for step in range(100))
    turns.accept(a_turn(-1, 0))
    assert [leaving(turns, step) for step in range(FIRST_STEP + 1)] == [[], [], [0]]
    turns.accept(a_turn(2, 1))
    turns.accept(a_turn(2, 2))
    assert leaving(turns, 3) == [1, 2]


def test_without_an_operator_nothing_is_taken() -> None:
    turns = Turns(OFF)
    assert turns.accept(a_turn(0, 1))
    assert leaving(turns, 9) == []


@pytest.mark.parametrize("mode", [AWAITED, LIVE])
def test_no_more_commands_leave_in_a_step_than_fit_into_a_turn(mode: str) -> None:
    """So what a person gave at once can be given by a script, in the same steps."""
    turns = Turns(mode)
    for turn in range(3):
        turns.accept(a_turn(turn, *range(16 * turn, 16 * turn + 16)))
    gone = [leaving(turns, step) for step in range(2, 7)]
    assert [number for numbers in gone for number in numbers] == list(range(48))
    assert max(map(len, gone)) == MAX_IN_TURN


def test_only_so_many_commands_may_wait() -> None:
    """The turn that is too much is dropped as a whole, and others come after it."""
    turns = Turns(LIVE)
    for first in range(0, MAX_WAITING, MAX_IN_TURN):
        assert turns.accept(a_turn(5, *range(first, first + MAX_IN_TURN))) is None
    assert turns.accept(a_turn(5, 999))
    leaving(turns, 6)
    assert turns.accept(a_turn(6, 999)) is None


@pytest.mark.parametrize("jitter_s", [0.0, 3.0])
def test_a_crowded_agent_still_hears_the_base(jitter_s: float) -> None:
    """Its frame stays within the limit of the link, also where frames of the base are delayed into one step."""
    stage = Stage(120, downlink={"repeat_s": 1, "jitter_s": jitter_s}, radio={"range_m": 200})
    stage.core.turns.mode = LIVE
    many = tuple([sign(a_command(number, name="n" * 60, life_s=500)) for number in range(16)])
    heard = 0
    for step in range(30):
        frames = stage.begin()
        for frame in frames.values():
            heard += sum(sender == BASE_ID for sender, _ in frame.heard)
            full = frame._replace(poses=((0.5, 0.5),) * MAX_POSES)
            assert decode_frame(encode_frame(full)).heard == frame.heard
        if step > 0:
            assert sum(len(data) for _, data in frames[0].heard) > FRAME_ROOM_BYTES - 2000
        for agent in frames:
            stage.say(agent, b"x" * 300)
        stage.core.turns.accept(Turn(step, many if step == 1 else ()))
        stage.end()
    assert heard > 15 * 120


def test_what_the_base_says_is_in_the_digest_and_not_in_the_books_of_frames() -> None:
    """Two worlds whose agents hear different commands differ, though all else is the same."""
    digests = []
    for number in (1, 2):
        stage = Stage(3)
        stage.core.turns.mode = LIVE
        stage.core.turns.accept(Turn(0, (sign(a_command(number)),)))
        for _ in range(4):
            stage.begin()
            record = stage.end()
            assert record.frames_sent == record.frames_received == 0
        digests.append(stage.core.digest.hex())
        assert stage.core.totals(complete=True)["downlink"]["frames_heard"] == 3
    assert digests[0] != digests[1]
