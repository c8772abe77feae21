"""The lock-step: whom a step waits for, through any order of acts, hangs, deaths and returns."""

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from deltaswarm_world.core.lockstep import FORGIVEN_STEPS, LockStep, TimeoutBackoff

AGENTS = range(5)
agents = st.integers(0, 6)
"""Two more than there are: samples may come on any key."""


def begin(lockstep: LockStep, step: int) -> list[int]:
    """A step in which all that can be asked are asked."""
    taking_part = lockstep.taking_part()
    lockstep.begin(step, taking_part)
    return taking_part


class Life(RuleBasedStateMachine):
    """The lock-step beside a model that keeps each agent's condition by itself."""

    def __init__(self) -> None:
        super().__init__()
        self.lockstep = LockStep(AGENTS)
        self.condition = dict.fromkeys(AGENTS, "idle")
        """Of each agent that is there: idle, owing an act, or hanging."""
        self.missed: dict[int, int] = {}
        """The last step that an agent did not close."""
        self.deaths: list[tuple[int, int]] = []
        """Step and agent."""
        self.step = -1

    def those(self, condition: str) -> set[int]:
        """The agents of one condition."""
        return {agent for agent, found in self.condition.items() if found == condition}

    @precondition(lambda self: not self.those("owing"))
    @rule(skipped=st.integers(1, 3))
    def begin(self, skipped: int) -> None:
        """A step opens when the one before is closed; all that do not hang take part, in order."""
        self.step += skipped
        taking_part = begin(self.lockstep, self.step)
        assert taking_part == sorted(set(self.condition) - self.those("hanging"))
        self.condition |= dict.fromkeys(taking_part, "owing")
        assert self.lockstep.is_closed == (not taking_part)

    @rule(agent=agents, late=st.sampled_from([0, 0, 0, 1, 5]))
    def close(self, agent: int, late: int) -> None:
        """An act closes its agent's step once, if it is of this step; that of the missed step ends a hanging."""
        closes = self.condition.get(agent) == "owing" and late == 0
        assert self.lockstep.close(agent, self.step - late) == closes
        returns = self.condition.get(agent) == "hanging" and self.step - late >= self.missed[agent]
        assert closes or self.lockstep.answer_late(agent, self.step - late) == returns
        if closes or returns:
            self.condition[agent] = "idle"

    @rule()
    def give_up(self) -> None:
        """Who still owes its act hangs."""
        assert self.lockstep.give_up() == sorted(self.those("owing"))
        self.missed |= dict.fromkeys(self.those("owing"), self.step)
        self.condition |= dict.fromkeys(self.those("owing"), "hanging")
        assert self.lockstep.is_closed

    @rule(agent=agents)
    def gone(self, agent: int) -> None:
        """A dead agent is waited for no longer, and is noted once per death."""
        self.lockstep.gone(agent)
        if self.condition.pop(agent, None):
            self.deaths.append((self.step, agent))

    @rule(agent=st.sampled_from(AGENTS))
    def back(self, agent: int) -> None:
        """It takes part from the next step on, not in this one; the return of one that is there is nothing."""
        self.lockstep.back(agent)
        self.condition.setdefault(agent, "idle")

    @invariant()
    def waits_for_those_who_owe(self) -> None:
        """Whoever is waited for is alive and does not hang, and the step is closed when there is none."""
        lockstep = self.lockstep
        assert lockstep.waiting == self.those("owing")
        assert lockstep.waiting <= lockstep.alive - lockstep.hanging
        assert lockstep.is_closed == (not lockstep.waiting)

    @invariant()
    def keeps_the_books(self) -> None:
        """Alive are those that did not die or came back; only the living hang; each death is on the list."""
        assert self.lockstep.alive == set(self.condition)
        assert self.lockstep.hanging == self.those("hanging")
        assert self.lockstep.lost == [agent for _, agent in sorted(self.deaths)]


TestLife = Life.TestCase
TestLife.settings = settings(max_examples=100, stateful_step_count=30)


def test_a_step_in_order() -> None:
    """Begin, one act each, closed."""
    lockstep = LockStep([2, 0, 1])
    assert begin(lockstep, 0) == [0, 1, 2]
    assert [lockstep.close(agent, 0) for agent in (1, 2, 0)] == [True] * 3
    assert lockstep.is_closed
    assert lockstep.give_up() == []


def test_one_act_closes_one_step() -> None:
    """A second one does not close anything, nor does one of a step before."""
    lockstep = LockStep([0, 1])
    begin(lockstep, 7)
    assert not lockstep.close(0, 6)
    assert lockstep.close(0, 7)
    assert not lockstep.close(0, 7)
    assert lockstep.waiting == {1}


def test_a_hanging_agent_rejoins_at_the_next_step() -> None:
    """Its late act brings it back, but not into the step under way."""
    lockstep = LockStep([0, 1])
    begin(lockstep, 0)
    lockstep.close(0, 0)
    assert lockstep.give_up() == [1]
    assert begin(lockstep, 1) == [0]
    assert not lockstep.answer_late(1, -1), "not the act of the step that it missed"
    assert not lockstep.close(1, 0)
    assert lockstep.answer_late(1, 0)
    assert not lockstep.answer_late(1, 0), "it owes one"
    assert lockstep.waiting == {0}
    lockstep.close(0, 1)
    assert begin(lockstep, 2) == [0, 1]


def test_a_board_may_answer_each_knock() -> None:
    """Frames that it got while it hung lie in its queue, and it answers one after the other."""
    lockstep = LockStep([0, 1], [1])
    begin(lockstep, 0)
    lockstep.close(0, 0)
    lockstep.give_up()
    for step in (1, 2):
        lockstep.probe()
        begin(lockstep, step)
        lockstep.close(0, step)
        lockstep.give_up()
    begin(lockstep, 3)
    assert [lockstep.answer_late(1, step) for step in (0, 1, 2, 2)] == [True, True, True, False]
    assert not lockstep.unanswered(1)


def test_who_closes_a_step_owes_nothing_of_before() -> None:
    """A process that was started anew never answers for the one before it, and may say no more than others for that."""
    lockstep = LockStep([0, 1], [1])
    for step in range(3):
        begin(lockstep, step)
        lockstep.gone(1)
        lockstep.back(1)
    begin(lockstep, 3)
    assert lockstep.close(1, 3)
    assert not lockstep.unanswered(1)
    assert not lockstep.answer_late(1, 0)


@pytest.mark.parametrize("steps_away", [0, 1, 5])
@pytest.mark.parametrize("hung", [False, True])
def test_a_board_may_answer_after_an_absence_what_it_was_asked_before(steps_away: int, hung: bool) -> None:
    """Its process went on behind a cut link: its answer closes nothing, and is not one too many. A second one is."""
    lockstep = LockStep([0, 1], [1])
    begin(lockstep, 0)
    if hung:
        lockstep.close(0, 0)
        lockstep.give_up()
        begin(lockstep, 1)
    lockstep.gone(1)
    for step in range(2, 2 + steps_away):
        begin(lockstep, step)
    lockstep.back(1)
    assert lockstep.unanswered(1)
    assert [(lockstep.close(1, 0), lockstep.answer_late(1, 0)) for _ in range(2)] == [(False, True), (False, False)]
    assert not lockstep.unanswered(1)


def test_an_agent_that_is_late_again_and_again_costs_little() -> None:
    """Nine thousand steps in which it misses each: less than a minute; and a single miss is forgotten."""
    backoff = TimeoutBackoff(5.0)
    waited_s = 0.0
    for step in range(9000):
        waited_s += backoff.left_s(0, step)
        backoff.missed(0, step)
    assert 10.0 <= waited_s < 60.0
    assert backoff.left_s(1, 9000) == 5.0
    once = TimeoutBackoff(5.0)
    once.missed(0, 10)
    assert [once.left_s(0, step) for step in (11, 10 + FORGIVEN_STEPS)] == [2.5, 5.0]


def test_those_lost_in_one_step_are_listed_by_number() -> None:
    """In whatever order the news of them comes, which no two runs share."""
    lockstep = LockStep(range(5))
    for step, going in enumerate([[4], [3, 0], [2, 1]]):
        begin(lockstep, step)
        for agent in going:
            lockstep.gone(agent)
    assert lockstep.lost == [4, 0, 3, 1, 2]


def test_a_step_without_agents_is_closed() -> None:
    """When all have died the world goes on, for whoever watches it."""
    lockstep = LockStep([0])
    lockstep.gone(0)
    assert begin(lockstep, 0) == []
    assert lockstep.is_closed
