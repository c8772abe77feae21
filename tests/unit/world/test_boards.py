"""Boards in the world's books: how they took part, what they may say late, and that their absence is no loss."""

from collections import deque
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.truth import StepRecord
from deltaswarm_wire.keys import ACT, RADIO, REPORT
from deltaswarm_wire.messages import encode_act
from deltaswarm_wire.operator_messages import Report, decode_report, encode_report
from deltaswarm_world.core.participants import Attendance, Participants
from tests.support.worlds import Stage, an_act, begin, sample

AGENT, BOARD = 0, 1


def test_a_board_that_goes_is_counted_and_not_lost() -> None:
    """An agent that goes is lost; before the first step a board may come and go as it likes."""
    participants = Participants([AGENT, BOARD], [BOARD])
    participants.token_gone(BOARD)
    participants.token_back(BOARD)
    begin(participants, 0)
    for _ in range(2):
        participants.token_gone(BOARD)
        participants.token_gone(BOARD)
        participants.token_back(BOARD)
    participants.token_gone(AGENT)
    assert participants.lost == [AGENT]
    assert participants.boards == {BOARD: Attendance(late_steps=0, absences=2, absent_steps=0)}


def test_steps_without_a_board_are_counted() -> None:
    """Those that it was away for, and those that it was there for and did not close, each once."""
    participants = Participants([AGENT, BOARD], [BOARD])
    for step in range(3):  # there, and silent
        begin(participants, step)
        participants.answer(AGENT, step)
        participants.time_out()
    participants.token_gone(BOARD)
    for step in range(3, 8):
        assert begin(participants, step) == [AGENT]
        participants.answer(AGENT, step)
        participants.time_out()
    participants.token_back(BOARD)
    assert begin(participants, 8) == [AGENT, BOARD]
    for agent in (AGENT, BOARD):
        participants.answer(agent, 8)
    participants.time_out()
    assert participants.boards == {BOARD: Attendance(late_steps=3, absences=1, absent_steps=5)}


def test_only_boards_that_hang_are_knocked_for() -> None:
    """An agent of this machine that hangs answers when it can."""
    participants = Participants([AGENT, BOARD, 2], [BOARD, 2])
    begin(participants, 0)
    participants.answer(2, 0)
    participants.time_out()
    assert participants.hung == {AGENT, BOARD}
    assert participants.probe() == [BOARD]


def lost_over(counters: list[int], *, away_before: int | None, **tables: Any) -> list[int]:
    """What counts as lost in each step in which the board says this; it goes and comes back before one of them."""
    stage = Stage(2, [BOARD], **tables)
    lost = []
    for position, counter in enumerate(counters):
        if position == away_before:
            stage.core.participants.token_gone(BOARD)
            stage.core.participants.token_back(BOARD)
            stage.core.intake.accept_any_next(BOARD)
        stage.begin()
        stage.counters[BOARD] = counter
        stage.say(BOARD)
        report = encode_report(Report(BOARD, counter, stage.step, "root", 1.0, 1.0, 0, ()))
        assert stage.core.intake.hear_report(BOARD, report) is None
        lost.append(stage.end().transport_lost)
    return lost


def test_what_a_board_said_while_it_was_away_is_no_loss() -> None:
    """Its process went on, or began anew: both are well. A gap at another time is a loss, of a frame and a report."""
    assert lost_over([0, 1, 40, 41, 43], away_before=2) == [0, 0, 0, 0, 2]
    assert lost_over([0, 1, 0, 1, 3], away_before=2) == [0, 0, 0, 0, 2]
    assert lost_over([0, 1, 40, 41, 43], away_before=None) == [0, 0, 76, 0, 2]


def test_a_knock_brings_a_frame_that_nobody_waits_for() -> None:
    """Once; and the answer brings the board back into the next step."""
    stage = Stage(2, [BOARD])
    stage.begin()
    stage.end(BOARD)
    assert set(stage.begin()) == {AGENT}
    stage.end()
    frames = stage.begin(last=True, probe=True)
    assert set(frames) == {AGENT, BOARD}
    assert frames[BOARD].last
    assert stage.core.participants.asked == {AGENT}
    assert stage.act(BOARD) is None
    stage.end()
    assert set(stage.begin()) == {AGENT, BOARD}
    stage.end(BOARD)
    assert set(stage.begin()) == {AGENT}, "a probe is for one step"


ALL = 1000


def act_of(step: int) -> bytes:
    return encode_act(an_act(step))


def report_of(step: int, sequence: int) -> bytes:
    return encode_report(Report(BOARD, sequence, step, "root", 1.0, 1.0, 0, ()))


class Late:
    """A world with an agent, which is always in time, and a board, which answers its frames in order at some time."""

    def __init__(self, **tables: Any) -> None:
        self.core = Stage(2, [BOARD], **tables).core
        self.records: list[StepRecord] = []
        self.frames: deque[int] = deque()
        """The steps of the frames that the board has not answered."""
        self.reported: list[int] = []
        self.forwarded: list[int] = []
        self.step = -1

    def hear(self, leaf: str, data: bytes, act: bytes | None = None) -> str | None:
        return self.core.intake.receive(BOARD, leaf, data, act)

    def answer(self, step: int) -> None:
        number = len(self.reported)
        report = report_of(step, number)
        assert self.hear(REPORT, report) is None
        assert self.hear(REPORT, report) is not None
        assert self.hear(RADIO, sample(number, b"%d" % step), act_of(step)) is None
        self.reported.append(step)

    def play(self, *, probed: bool, answers: int, last: bool = False) -> None:
        """Play a step; the board answers at most this many of its frames in it."""
        self.step += 1
        frames = self.core.begin(self.step, last=last, probe=probed)
        self.frames += [self.step for agent, _ in frames if agent == BOARD]
        self.core.intake.receive(AGENT, ACT, act_of(self.step), None)
        is_awaited = BOARD in self.core.participants.asked
        for _ in range(min(answers, len(self.frames))):
            self.answer(self.frames.popleft())
        is_closed = is_awaited and self.reported[-1:] == [self.step]
        said = self.core.intake.transmitted.get(BOARD)
        assert said == (sample(len(self.reported) - 1, b"%d" % self.step) if is_closed else None)
        self.records.append(self.core.end())
        self.forwarded += [decode_report(forwarded.report).step for forwarded in self.core.forwarded]

    def cut(self) -> None:
        for note in (
            self.core.participants.token_gone,
            self.core.participants.token_back,
            self.core.intake.accept_any_next,
        ):
            note(BOARD)


steps = st.tuples(st.booleans(), st.sampled_from([0, 0, 1, 1, 2, ALL]), st.sampled_from([False, False, True]))


@given(st.lists(steps, max_size=40))
def test_whatever_a_board_owes_it_may_say_once(moves: list[tuple[bool, int, bool]]) -> None:
    """Nothing is excess, nobody hears a frame of before, and the operator gets every report, one per step."""
    stage = Late()
    for probed, answers, is_cut in moves:
        stage.play(probed=probed, answers=answers)
        if is_cut:
            stage.cut()
    for _ in range(len(moves) + 3):
        stage.play(probed=True, answers=ALL)
    assert stage.frames == deque()
    while len(stage.forwarded) < len(stage.reported):
        stage.play(probed=False, answers=0)
    assert stage.forwarded == stage.reported
    assert stage.core.intake.excess == {BOARD: len(stage.reported)}, "each report was said twice"


def test_who_owes_nothing_may_say_nothing_of_before() -> None:
    """Not a report, nor a radio frame with its act: each of them is one too many."""
    stage = Late()
    stage.play(probed=False, answers=1)
    stage.core.begin(1, last=False)
    assert stage.hear(REPORT, report_of(0, 1)) is not None
    assert stage.hear(RADIO, sample(1, b"old"), act_of(0)) is not None
    assert stage.core.intake.transmitted == {}
    assert stage.core.intake.excess == {BOARD: 3}, "with the report that was said twice"


def test_reports_without_acts_are_taken_once_per_frame() -> None:
    """Who hangs for many steps cannot have many reports kept, though each is of another step."""
    stage = Late()
    for step in range(50):
        stage.play(probed=step in (20, 30), answers=0)
    reports = [report_of(step, step) for step in range(50)]
    assert [stage.hear(REPORT, report) is None for report in reports] == [True] * 3 + [False] * 47


@pytest.mark.parametrize("tables", [{}, {"uplink": {"latency_s": 2}}], ids=["at once", "by a slow uplink"])
def test_in_the_last_step_no_report_is_left_behind(tables: dict[str, Any]) -> None:
    """All that a late board reports then goes to the operator, or is counted as under way."""
    stage = Late(**tables)
    stage.play(probed=False, answers=ALL)
    for _ in range(6):
        stage.play(probed=True, answers=0)
    stage.play(probed=True, answers=ALL, last=True)
    assert len(stage.reported) > len(stage.forwarded) or not tables
    sent = sum(record.reports_sent for record in stage.records)
    assert sent == len(stage.reported)
    arrived = sum(record.reports_arrived for record in stage.records)
    assert arrived == len(stage.forwarded)
    assert sent == arrived + stage.records[-1].reports_in_flight
    assert bool(tables) or stage.forwarded == stage.reported
