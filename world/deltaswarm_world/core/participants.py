"""The participants of the lock-step: the condition of each agent, and every transition.

A step asks agents that are idle: each gets a frame, and the step is closed once all have answered with an act. An agent
that exceeds the time-out is hung: it gets no more frames until it answers the one that it missed. A frozen agent gets
none until it is thawed, and an absent agent has no process. An agent changes its condition only through `TRANSITIONS`;
what the table does not list changes nothing.

Boards are agents on machines of their own. They may come and go. A hung board is probed: it gets a frame now and then,
for which nobody waits. Its process may go on behind a cut link and answer frames from before, so the number of answers
still due is kept.

An agent-step is due unless a fault of the scenario prevents it: an order killed or froze the agent. It is answered if
the agent's act for that step has arrived when the step is closed; an act of an earlier step may still hold.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Set
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

MAX_RETURNS = 20
"""Number of times that an agent, unless it is a board, may come back after its process died."""


class Condition(StrEnum):
    """What a step may expect of an agent."""

    ABSENT = "absent"
    IDLE = "idle"
    ASKED = "asked"
    HUNG = "hung"
    FROZEN = "frozen"


class ConditionCause(StrEnum):
    """Why an agent changes its condition."""

    TOKEN = "its liveliness token appeared"
    TOKEN_GONE = "its liveliness token disappeared"
    KILLED = "killed by an order"
    FRAME = "got the frame of a step"
    ACT = "answered with an act"
    TIMEOUT = "exceeded the time-out"
    FREEZE = "frozen by an order"
    THAW = "thawed by an order"


ABSENT, IDLE, ASKED, HUNG, FROZEN = Condition

TRANSITIONS: dict[tuple[Condition, ConditionCause], Condition] = {
    (ABSENT, ConditionCause.TOKEN): IDLE,
    (IDLE, ConditionCause.FRAME): ASKED,
    (ASKED, ConditionCause.ACT): IDLE,
    (ASKED, ConditionCause.TIMEOUT): HUNG,
    (HUNG, ConditionCause.ACT): IDLE,
    (IDLE, ConditionCause.FREEZE): FROZEN,
    (HUNG, ConditionCause.FREEZE): FROZEN,
    (FROZEN, ConditionCause.THAW): IDLE,
    (IDLE, ConditionCause.TOKEN_GONE): ABSENT,
    (ASKED, ConditionCause.TOKEN_GONE): ABSENT,
    (HUNG, ConditionCause.TOKEN_GONE): ABSENT,
    (FROZEN, ConditionCause.TOKEN_GONE): ABSENT,
    (IDLE, ConditionCause.KILLED): ABSENT,
    (ASKED, ConditionCause.KILLED): ABSENT,
    (HUNG, ConditionCause.KILLED): ABSENT,
    (FROZEN, ConditionCause.KILLED): ABSENT,
}


@dataclass
class Attendance:
    late_steps: int = 0
    """Steps that the board missed while present."""
    absences: int = 0
    absent_steps: int = 0


@dataclass
class Missed:
    """The agent-steps that an agent missed for one cause."""

    step: int
    """The step in which it failed, or the first that it did not answer."""
    steps: int = 0
    """Number of agent-steps without an answer."""
    longest: int = 0
    """The largest number of them in a row."""
    cause: str = ""
    """Why, if the world knows."""
    _in_a_row: int = 0
    _newest: int = -1

    def count(self, step: int) -> None:
        self._in_a_row = self._in_a_row + 1 if self._newest == step - 1 else 1
        self._newest = step
        self.steps += 1
        self.longest = max(self.longest, self._in_a_row)


def as_rows(missed: Mapping[int, Missed]) -> list[dict[str, Any]]:
    return [
        {"agent": agent, "step": about.step, "steps": about.steps, "longest": about.longest}
        | ({"cause": about.cause} if about.cause else {})
        for agent, about in sorted(missed.items())
    ]


class Participants:
    """Keeps each agent's condition, and which acts are due. It has no clock; the caller has."""

    def __init__(self, agents: Iterable[int], boards: Iterable[int] = ()) -> None:
        self.step = -1
        self.lost: list[int] = []
        """Agents whose process died without an order, by step, ascending within a step."""
        self.lost_in_step: list[int] = []
        """The step of each loss, in the same order."""
        self.returned: set[int] = set()
        """Agents whose process reappeared, until the world handles it."""
        self.boards = {agent: Attendance() for agent in sorted(boards)}
        self.failed: dict[int, Missed] = {}
        """Agents whose process ended or whose link was cut although no order did it."""
        self.late: dict[int, Missed] = {}
        """Agents that were there and did not answer in time."""
        self.due = self.answered = 0
        """Number of agent-steps in which an answer was due, and was there."""
        self._killed: set[int] = set()
        """Agents that an order has killed and none has started again."""
        self._without: tuple[set[int], set[int]] = set(), set()
        """Agents that cannot answer this step: failed ones, and hung ones."""
        self._in: dict[Condition, set[int]] = {condition: set() for condition in Condition}
        """The agents in each condition; each agent is in one."""
        self._in[IDLE] = set(agents)
        self._due_now = 0
        """Number of agents of which an answer to this step is due."""
        self._lost_before = 0
        """Number of lost agents at the start of this step."""
        self._missed: dict[int, int] = {}
        """The step that each hung agent missed: an act for that or a later step ends the hang."""
        self._answers_due: Counter[int] = Counter()
        """Number of frames that may still be answered: probes, and frames from before an absence or a freeze."""

    @property
    def asked(self) -> Set[int]:
        return self._in[ASKED]

    @property
    def hung(self) -> Set[int]:
        """Agents that exceeded the time-out of a step and have not answered since."""
        return self._in[HUNG]

    @property
    def present(self) -> set[int]:
        return self._in[IDLE] | self._in[ASKED] | self._in[HUNG] | self._in[FROZEN]

    def taking_part(self) -> list[int]:
        """Return the agents that a step may ask, or has asked, ascending."""
        return sorted(self._in[IDLE] | self._in[ASKED])

    # A step

    def begin(self, step: int, asked: Iterable[int]) -> None:
        """Open a step, in which these agents get a frame."""
        self.step = step
        self._lost_before = len(self.lost)
        self._without = self._in[ABSENT] - self._killed, set(self._in[HUNG])
        self._due_now = sum(map(len, self._in.values())) - len(self._in[FROZEN]) - len(self._killed)
        self._change_all(set(asked), ConditionCause.FRAME)
        for agent, attendance in self.boards.items():
            attendance.absent_steps += agent in self._in[ABSENT]

    def probe(self) -> list[int]:
        """Return the hung boards, which get a frame in the next step; the step does not wait for their acts."""
        probed = sorted(self._in[HUNG] & self.boards.keys())
        self._answers_due.update(probed)
        return probed

    def unanswered(self, agent: int) -> int:
        return (agent in self._in[ASKED]) + (agent in self._in[HUNG]) + self._answers_due[agent]

    def answer(self, agent: int, step: int) -> bool:
        """Take an act; return whether it answers the frame of this step."""
        if step != self.step or agent not in self._in[ASKED]:
            return False
        self._answers_due.pop(agent, None)  # it answers in order: what is still due was lost
        self._in[ASKED].discard(agent)
        self._in[TRANSITIONS[ASKED, ConditionCause.ACT]].add(agent)
        return True

    def answer_late(self, agent: int, step: int) -> bool:
        """Take an act that does not answer the frame of this step; return whether it was still due."""
        if agent in self._in[HUNG] and step >= self._missed[agent]:
            return self._change(agent, ConditionCause.ACT)
        if self._answers_due[agent]:
            self._answers_due[agent] -= 1
            return True
        return False

    @property
    def is_closed(self) -> bool:
        return not self._in[ASKED]

    def time_out(self) -> list[int]:
        """Continue without the agents that have not answered, which are hung from now on; return them."""
        late = sorted(self._in[ASKED])
        for agent in late:
            self._missed[agent] = self.step
            self._change(agent, ConditionCause.TIMEOUT)
        for agent in self._in[HUNG] & self.boards.keys():
            self.boards[agent].late_steps += 1
        self._count(late)
        return late

    def _count(self, late: Collection[int]) -> None:
        failed, hung = self._without
        hung = hung.union(late) - failed
        for missed, agents in (self.failed, failed), (self.late, hung):
            for agent in sorted(agents):
                missed.setdefault(agent, Missed(self.step)).count(self.step)
        self.due += self._due_now
        self.answered += self._due_now - len(failed) - len(hung)

    @property
    def is_deserted(self) -> bool:
        """Whether no agent is left, and not by orders alone."""
        return len(self._in[ABSENT]) == sum(map(len, self._in.values())) > len(self._killed)

    # Processes

    def token_gone(self, agent: int, cause: str = "") -> None:
        """Note that an agent's liveliness token disappeared or will: an agent is lost, a board is absent."""
        is_asked, is_hung = agent in self._in[ASKED], agent in self._in[HUNG]
        if not self._change(agent, ConditionCause.TOKEN_GONE):
            return
        if self.step >= 0:
            self.failed.setdefault(agent, Missed(self.step, cause=cause))
        if is_asked:
            self._without[0].add(agent)
        if agent not in self.boards:
            self.lost[self._lost_before :] = sorted([*self.lost[self._lost_before :], agent])
            self.lost_in_step.append(self.step)
            return
        self._answers_due[agent] += is_asked or is_hung  # its process may be well, and answer once its link is back
        self.boards[agent].absences += self.step >= 0

    def token_back(self, agent: int) -> None:
        """Note that an agent's token reappeared; it takes part from the next step on, unless it died too often."""
        if self.lost.count(agent) <= MAX_RETURNS and self._change(agent, ConditionCause.TOKEN):
            self._killed.discard(agent)
            self.returned.add(agent)

    def kill(self, agent: int) -> None:
        """Remove an agent killed by an order, which does not count as lost."""
        if self._change(agent, ConditionCause.KILLED):
            self._killed.add(agent)

    def freeze(self, frozen: Collection[int]) -> None:
        """Freeze exactly these agents. A hung one may still answer the frame that it missed."""
        for agent in sorted(self._in[FROZEN].difference(frozen)):
            self._change(agent, ConditionCause.THAW)
        for agent in frozen:
            is_due = agent in self._in[HUNG]
            self._answers_due[agent] += self._change(agent, ConditionCause.FREEZE) and is_due

    def _change_all(self, agents: set[int], cause: ConditionCause) -> None:
        """Change the conditions of agents as the table says."""
        for condition, having in tuple(self._in.items()):
            after = TRANSITIONS.get((condition, cause))
            if after is not None and (changing := having & agents):
                having -= changing
                self._in[after] |= changing
                agents = agents - changing

    def _change(self, agent: int, cause: ConditionCause) -> bool:
        """Change an agent's condition as the table says; return whether the table lists a change."""
        for condition, agents in self._in.items():
            if agent in agents:
                after = TRANSITIONS.get((condition, cause))
                if after is None:
                    return False
                agents.discard(agent)
                self._in[after].add(agent)
                return True
        return False


def diagram() -> str:
    """Return the table as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", f"    [*] --> {IDLE.value}"]
    lines += [
        f"    {source.value} --> {target.value}: {cause.value}" for (source, cause), target in TRANSITIONS.items()
    ]
    return "\n".join(lines) + "\n"
