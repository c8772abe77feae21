"""The lock-step: whose act a step still waits for, who is late, who is gone."""

from collections.abc import Iterable
from dataclasses import dataclass


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

    def close(self, agent: int, step: int) -> bool:
        """An act arrived; True if it closes the agent's step, False if it is late or comes twice."""
        if agent in self.waiting and step == self.step:
            self.waiting.discard(agent)
            return True
        self.hanging.discard(agent)
        return False

    @property
    def is_closed(self) -> bool:
        """Whether nobody is waited for."""
        return not self.waiting

    def give_up(self) -> list[int]:
        """Go on without those who are waited for; they hang until they are heard again."""
        late = sorted(self.waiting)
        self.hanging |= self.waiting
        for agent in self.hanging & self.boards.keys():
            self.boards[agent].late_steps += 1
        self.waiting = set()
        return late

    def probe(self) -> None:
        """Send the boards that hang a frame, with the next step."""
        self.probed = sorted(self.hanging & self.boards.keys())

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
            self.returned.add(agent)
            self.hanging.discard(agent)
