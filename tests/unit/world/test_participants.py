"""The participants of the lock-step: their conditions through any order of acts, time-outs, deaths and returns."""

from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from deltaswarm_world.core.participants import TRANSITIONS, Condition, ConditionCause, Participants, diagram
from tests.support.worlds import begin

PAGE = Path(__file__).parents[3] / "docs" / "PARTICIPANTS.md"
AGENTS = range(5)
agents = st.integers(0, 6)
"""Two more than there are: samples may come on any key."""


class Life(RuleBasedStateMachine):
    """The participants beside a model that keeps each agent's condition by itself."""

    def __init__(self) -> None:
        super().__init__()
        self.participants = Participants(AGENTS)
        self.condition = dict.fromkeys(AGENTS, "idle")
        self.missed: dict[int, int] = {}
        """The last step that an agent did not close."""
        self.due: dict[int, int] = dict.fromkeys(AGENTS, 0)
        """Frames from before a freeze, which may still be answered."""
        self.deaths: list[tuple[int, int]] = []
        """Step and agent."""
        self.step = -1

    def those(self, *conditions: str) -> set[int]:
        return {agent for agent, condition in self.condition.items() if condition in conditions}

    @precondition(lambda self: not self.those("asked"))
    @rule(skipped=st.integers(1, 3))
    def begin(self, skipped: int) -> None:
        """A step opens when the one before is closed; all idle agents take part, in order."""
        self.step += skipped
        taking_part = begin(self.participants, self.step)
        assert taking_part == sorted(self.those("idle"))
        self.condition |= dict.fromkeys(taking_part, "asked")

    @rule(agent=agents, late=st.sampled_from([0, 0, 0, 1, 5]))
    def act(self, agent: int, late: int) -> None:
        """An act closes its agent's step once, if it is of this step; that of the missed step ends a hang."""
        closes = self.condition.get(agent) == "asked" and late == 0
        assert self.participants.answer(agent, self.step - late) == closes
        if closes:
            self.condition[agent], self.due[agent] = "idle", 0
            return
        returns = self.condition.get(agent) == "hung" and self.step - late >= self.missed[agent]
        is_due = returns or self.due.get(agent, 0) > 0
        assert self.participants.answer_late(agent, self.step - late) == is_due
        if returns:
            self.condition[agent] = "idle"
        elif is_due:
            self.due[agent] -= 1

    @rule()
    def time_out(self) -> None:
        """An agent that has not answered is hung."""
        asked = self.those("asked")
        assert self.participants.time_out() == sorted(asked)
        self.missed |= dict.fromkeys(asked, self.step)
        self.condition |= dict.fromkeys(asked, "hung")

    @rule(agent=agents)
    def token_gone(self, agent: int) -> None:
        """A dead agent is waited for no longer, and is noted once per death."""
        self.participants.token_gone(agent)
        if self.condition.get(agent, "absent") != "absent":
            self.condition[agent] = "absent"
            self.deaths.append((self.step, agent))

    @rule(agent=st.sampled_from(AGENTS))
    def token_back(self, agent: int) -> None:
        """It takes part from the next step on, not in this one; the return of a present one changes nothing."""
        self.participants.token_back(agent)
        if self.condition[agent] == "absent":
            self.condition[agent] = "idle"

    @rule(agent=agents)
    def kill(self, agent: int) -> None:
        """A death by order is no loss."""
        self.participants.kill(agent)
        if agent in self.condition:
            self.condition[agent] = "absent"

    @precondition(lambda self: not self.those("asked"))
    @rule(frozen=st.sets(st.sampled_from(AGENTS)))
    def freeze(self, frozen: set[int]) -> None:
        """Between steps exactly these are frozen, of those that are present; the others are thawed and idle."""
        self.participants.freeze(frozen)
        self.condition |= dict.fromkeys(self.those("frozen") - frozen, "idle")
        for agent in frozen & self.those("hung"):
            self.due[agent] += 1
        self.condition |= dict.fromkeys(frozen & self.those("idle", "hung"), "frozen")

    @invariant()
    def each_agent_is_in_its_condition(self) -> None:
        """The step waits for those who are asked; each death is on the list."""
        participants = self.participants
        assert participants.asked == self.those("asked")
        assert participants.hung == self.those("hung")
        assert participants.present == self.those("idle", "asked", "hung", "frozen")
        assert participants.taking_part() == sorted(self.those("idle", "asked"))
        assert participants.is_closed == (not participants.asked)
        assert participants.lost == [agent for _, agent in sorted(self.deaths)]


TestLife = Life.TestCase
TestLife.settings = settings(stateful_step_count=30)


def test_a_board_may_answer_each_knock() -> None:
    """Frames that it got while it hung lie in its queue, and it answers one after the other."""
    participants = Participants([0, 1], [1])
    begin(participants, 0)
    participants.answer(0, 0)
    participants.time_out()
    for step in (1, 2):
        participants.probe()
        begin(participants, step)
        participants.answer(0, step)
        participants.time_out()
    begin(participants, 3)
    assert [participants.answer_late(1, step) for step in (0, 1, 2, 2)] == [True, True, True, False]
    assert not participants.unanswered(1)


def test_who_closes_a_step_owes_nothing_of_before() -> None:
    """A process that was started anew never answers for the one before it, and may say no more than others for that."""
    participants = Participants([0, 1], [1])
    for step in range(3):
        begin(participants, step)
        participants.token_gone(1)
        participants.token_back(1)
    begin(participants, 3)
    assert participants.answer(1, 3)
    assert not participants.unanswered(1)
    assert not participants.answer_late(1, 0)


@pytest.mark.parametrize("steps_away", [0, 1, 5])
@pytest.mark.parametrize("hung", [False, True])
def test_a_board_may_answer_after_an_absence_what_it_was_asked_before(steps_away: int, hung: bool) -> None:
    """Its process went on behind a cut link: its answer closes nothing, and is not one too many. A second one is."""
    participants = Participants([0, 1], [1])
    begin(participants, 0)
    if hung:
        participants.answer(0, 0)
        participants.time_out()
        begin(participants, 1)
    participants.token_gone(1)
    for step in range(2, 2 + steps_away):
        begin(participants, step)
    participants.token_back(1)
    assert participants.unanswered(1)
    assert [(participants.answer(1, 0), participants.answer_late(1, 0)) for _ in range(2)] == [
        (False, True),
        (False, False),
    ]
    assert not participants.unanswered(1)


def test_an_absent_agent_is_neither_asked_nor_frozen() -> None:
    """The only way out of absence is a process."""
    causes = {cause for condition, cause in TRANSITIONS if condition is Condition.ABSENT}
    assert causes == {ConditionCause.TOKEN}


def test_the_page_shows_the_table() -> None:
    """The diagram is drawn from the code's table."""
    [block] = PAGE.read_text().split("```mermaid\n")[1:]
    assert block.split("```")[0] == diagram()


LEAVES, DIES, WAKES, KILLED, STARTED, FROZEN = "leaves", "dies", "wakes", "killed", "started", "frozen"


def counted(days: list[dict[int, str]], boards: tuple[int, ...] = ()) -> Participants:
    """Participants 0 to 2 after these steps, in which all answer to whom nothing happens.

    Before a step an agent may be killed, started, or frozen (and thawed in the next) by an order, wake up or leave; in
    the step it may die without an answer, or hang.
    """
    participants = Participants(range(3), boards)
    for step, day in enumerate(days):
        for agent, what in day.items():
            if what == KILLED:
                participants.kill(agent)
            elif what in (STARTED, WAKES):
                participants.token_back(agent) if what == STARTED else participants.answer_late(agent, step - 1)
            elif what == LEAVES:
                participants.token_gone(agent)
        participants.freeze({agent for agent, what in day.items() if what == FROZEN})
        begin(participants, step)
        for agent in sorted(participants.asked):
            if day.get(agent) == DIES:
                participants.token_gone(agent)
            elif day.get(agent) != "hangs":
                participants.answer(agent, step)
        participants.time_out()
    return participants


QUIET: dict[int, str] = {}


@pytest.mark.parametrize(
    ("days", "due", "answered", "failed", "late"),
    [
        ([QUIET] * 4, 12, 12, {}, {}),
        # Although no order made it
        ([QUIET, {1: DIES}, QUIET, QUIET], 12, 9, {1: (1, 3)}, {}),
        ([QUIET, QUIET, QUIET, {1: DIES}], 12, 11, {1: (3, 1)}, {}),
        ([QUIET, {1: LEAVES}, QUIET, QUIET], 12, 9, {1: (0, 3)}, {}),
        ([{0: DIES, 1: DIES, 2: DIES}], 3, 0, {0: (0, 1), 1: (0, 1), 2: (0, 1)}, {}),
        ([QUIET, {1: "hangs"}, QUIET, QUIET], 12, 9, {}, {1: (1, 3)}),
        ([QUIET, {1: "hangs"}, {1: WAKES}, QUIET], 12, 11, {}, {1: (1, 1)}),
        ([{1: "hangs"}, {1: LEAVES}, QUIET], 9, 6, {1: (0, 2)}, {1: (0, 1)}),
        ([{1: DIES}, {1: STARTED}, QUIET], 9, 8, {1: (0, 1)}, {}),
        # By orders
        ([QUIET, {1: KILLED}, QUIET, QUIET], 9, 9, {}, {}),
        ([QUIET, {1: KILLED}, {1: STARTED}, QUIET], 11, 11, {}, {}),
        ([{1: KILLED}, QUIET, {1: STARTED}, QUIET], 10, 10, {}, {}),
        ([QUIET, {1: FROZEN}, {1: FROZEN}, QUIET], 10, 10, {}, {}),
        ([{0: KILLED, 1: KILLED, 2: KILLED}, QUIET], 0, 0, {}, {}),
        # Both
        ([{1: "hangs"}, {1: KILLED}, QUIET], 7, 6, {}, {1: (0, 1)}),
        ([{1: "hangs"}, {1: FROZEN}, QUIET], 8, 7, {}, {1: (0, 1)}),
        ([{1: DIES}, {1: KILLED}, QUIET], 9, 6, {1: (0, 3)}, {}),
        ([{1: KILLED}, {1: STARTED, 2: KILLED}, {1: DIES}], 6, 5, {1: (2, 1)}, {}),
    ],
)
def test_agent_steps_are_due_unless_an_order_takes_them(
    days: list[dict[int, str]],
    due: int,
    answered: int,
    failed: dict[int, tuple[int, int]],
    late: dict[int, tuple[int, int]],
) -> None:
    """And answered if the answer was there when the step was closed; each failure has its step and what it cost."""
    participants = counted(days)
    assert (participants.due, participants.answered) == (due, answered)
    for found, expected in (participants.failed, failed), (participants.late, late):
        assert {agent: (missed.step, missed.steps) for agent, missed in found.items()} == expected


def test_a_board_that_is_away_or_late_misses_steps_like_any_agent() -> None:
    """Its coming and going is no loss of a process; what it did not answer is missing."""
    participants = counted([QUIET, {1: LEAVES, 2: "hangs"}, QUIET, {1: STARTED}], boards=(1, 2))
    assert participants.lost == []
    assert (participants.due, participants.answered) == (12, 7)
    assert (participants.failed[1].steps, participants.late[2].steps, participants.late[2].longest) == (2, 3, 3)


@pytest.mark.parametrize(
    ("days", "is_deserted"),
    [
        ([{0: DIES, 1: DIES, 2: DIES}], True),
        ([{0: KILLED, 1: DIES, 2: DIES}], True),
        ([{0: KILLED, 1: KILLED, 2: KILLED}], False),
        ([{0: DIES, 1: DIES, 2: "hangs"}], False),
        ([{0: DIES, 1: DIES, 2: DIES}, {2: STARTED}], False),
        ([{0: DIES, 1: DIES, 2: FROZEN}], False),
    ],
)
def test_a_swarm_is_deserted_if_not_all_of_it_was_killed_by_orders(
    days: list[dict[int, str]], is_deserted: bool
) -> None:
    """A run in which faults kill all goes on: that is what was asked for."""
    assert counted(days).is_deserted is is_deserted
