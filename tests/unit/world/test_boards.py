"""Boards in the world's books: how they took part, and that their absence is no loss of the fabric."""

from typing import Any

from deltaswarm_wire.operator_messages import Report, encode_report
from deltaswarm_world.core.participants import Attendance, Participants
from tests.support.worlds import Stage, begin

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
