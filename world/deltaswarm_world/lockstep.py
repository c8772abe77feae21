"""The lock-step: whose act a step still waits for, who is late, who is gone."""

from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass

FORGIVEN_STEPS = 2500
"""After so many steps the patience with an agent that was late doubles again, up to where it began."""

MAX_MISSES = 20
"""More are not counted: there is next to no patience left."""


class Patience:
    """How long a step waits for an agent: half as long after each step that it missed.

    So an agent that is late again and again costs a run of n steps at most (2 + n / FORGIVEN_STEPS) times `most_s` [s].
    """

    def __init__(self, most_s: float) -> None:
        self._most_s = most_s
        self._misses: Counter[int] = Counter()
        self._forgiven_at: dict[int, int] = {}
        """The step at which the next miss of an agent is forgiven."""

    def left_s(self, agent: int, step: int) -> float:
        """How long this step may wait for an agent [s]."""
        return self._most_s * 0.5 ** self._counted(agent, step)

    def with_any(self, agents: Collection[int], step: int) -> tuple[float, float]:
        """The shortest and the longest time that this step may wait for one of these agents [s]."""
        if not self._misses or not agents:
            return self._most_s, self._most_s
        left_s = [self.left_s(agent, step) for agent in agents]
        return min(left_s), max(left_s)

    def missed(self, agent: int, step: int) -> None:
        """An agent did not close this step in time."""
        if not self._counted(agent, step):
            self._forgiven_at[agent] = step + FORGIVEN_STEPS
        self._misses[agent] = min(self._misses[agent] + 1, MAX_MISSES)

    def _counted(self, agent: int, step: int) -> int:
        while self._misses[agent] and step >= self._forgiven_at[agent]:
            self._misses[agent] -= 1
            self._forgiven_at[agent] += FORGIVEN_STEPS
        return self._misses[agent]


@dataclass
class Attendance:
    """How a board took part in a run."""

    late_steps: int = 0
    """Steps that it was there for and did not close in time."""
    absences: int = 0
    """Times that it went."""
    absent_steps: int = 0
    """Steps that it was away for."""


class LockStep:
    """Keeps the set of agents that a step waits for. Time is the caller's; this holds no clock.

    `boards` are agents on machines of their own: they may come and go, and how they did is counted.
    """

    def __init__(self, agents: Iterable[int], boards: Iterable[int] = ()) -> None:
        self.alive = set(agents)
        """Agents whose process is there."""
        self.waiting: set[int] = set()
        """Agents that got the frame of this step and have not closed it."""
        self.hanging: set[int] = set()
        """Agents that missed a step's end; they get no frame until an act of theirs arrives."""
        self.lost: list[int] = []
        """Agents whose process went unasked, by step; those of one step ascending, in whatever order they went."""
        self._lost_before = 0
        """How many had gone when this step began."""
        self.returned: set[int] = set()
        """Agents whose process appeared again, until the world takes note."""
        self.frozen: frozenset[int] = frozenset()
        """Agents that are made to stand still; they get no frame, and nobody waits for them."""
        self.boards = {agent: Attendance() for agent in sorted(boards)}
        self.probed: list[int] = []
        """Boards that hang and get the next frame all the same, unwaited for: who was started anew owes no act."""
        self._missed: dict[int, int] = {}
        """The step that each hanging agent missed: its act ends the hanging, or a later one."""
        self._answers_due: Counter[int] = Counter()
        """Frames that boards got while they hung, and may still answer."""
        self.step = -1

    def taking_part(self) -> list[int]:
        """The agents whose process is there and goes on, ascending."""
        return sorted(self.alive - self.hanging - self.frozen)

    def begin(self, step: int, asked: Iterable[int]) -> None:
        """Open a step, in which these agents get a frame."""
        self.step = step
        self._lost_before = len(self.lost)
        self.waiting = set(asked)
        for agent, attendance in self.boards.items():
            attendance.absent_steps += agent not in self.alive

    def may_speak(self, agent: int) -> bool:
        """Whether an agent has a frame that it has not answered with its act."""
        return agent in self.waiting or agent in self.hanging or self._answers_due[agent] > 0

    def close(self, agent: int, step: int) -> bool:
        """An act arrived; True if it closes the agent's step."""
        if agent in self.waiting and step == self.step:
            self.waiting.discard(agent)
            return True
        return False

    def answer_late(self, agent: int, step: int) -> bool:
        """An act arrived that closes nothing; True if it was still due, as it is from an agent that hangs."""
        if agent in self.hanging and step >= self._missed[agent]:
            self.hanging.discard(agent)
            return True
        if self._answers_due[agent] and step < self.step:
            self._answers_due[agent] -= 1
            return True
        return False

    @property
    def is_closed(self) -> bool:
        """Whether nobody is waited for."""
        return not self.waiting

    def give_up(self) -> list[int]:
        """Go on without those who are waited for; they hang until they are heard again."""
        late = sorted(self.waiting)
        self.hanging |= self.waiting
        self._missed |= dict.fromkeys(late, self.step)
        for agent in self.hanging & self.boards.keys():
            self.boards[agent].late_steps += 1
        self.waiting = set()
        return late

    def probe(self) -> None:
        """Send the boards that hang a frame, with the next step."""
        self.probed = sorted(self.hanging & self.boards.keys())
        self._answers_due.update(self.probed)

    def gone(self, agent: int) -> None:
        """An agent's liveliness token went."""
        if agent in self.alive:
            self.alive.discard(agent)
            self.waiting.discard(agent)
            self.hanging.discard(agent)
            if agent not in self.boards:
                self.lost[self._lost_before :] = sorted([*self.lost[self._lost_before :], agent])
            elif self.step >= 0:
                self.boards[agent].absences += 1

    def take_out(self, agent: int) -> None:
        """An agent dies as planned: its token's end is no news, and it is not among the lost."""
        self.alive.discard(agent)
        self.waiting.discard(agent)
        self.hanging.discard(agent)

    def back(self, agent: int) -> None:
        """An agent's token appeared again; it takes part from the next step on."""
        if agent not in self.alive:
            self.alive.add(agent)
            self._answers_due[agent] = 0
            self.returned.add(agent)
            self.hanging.discard(agent)
