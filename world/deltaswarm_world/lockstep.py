"""The lock-step: whose act a step still waits for, who is late, who is gone."""

from collections.abc import Iterable


class LockStep:
    """Keeps the set of agents that a step waits for. Time is the caller's; this holds no clock."""

    def __init__(self, agents: Iterable[int]) -> None:
        self.alive = set(agents)
        """Agents whose process is there."""
        self.waiting: set[int] = set()
        """Agents that got the frame of this step and have not closed it."""
        self.hanging: set[int] = set()
        """Agents that missed a step's end; they get no frame until an act of theirs arrives."""
        self.lost: list[int] = []
        """Agents whose process went unasked, in that order."""
        self.frozen: frozenset[int] = frozenset()
        """Agents that are made to stand still; they get no frame, and nobody waits for them."""
        self.step = -1

    def begin(self, step: int) -> list[int]:
        """Open a step; the agents that take part in it, ascending."""
        self.step = step
        self.waiting = self.alive - self.hanging - self.frozen
        return sorted(self.waiting)

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
        self.waiting = set()
        return late

    def gone(self, agent: int) -> None:
        """An agent's liveliness token went."""
        if agent in self.alive:
            self.alive.discard(agent)
            self.waiting.discard(agent)
            self.hanging.discard(agent)
            self.lost.append(agent)

    def take_out(self, agent: int) -> None:
        """An agent dies as planned: its token's end is no news, and it is not among the lost."""
        self.alive.discard(agent)
        self.waiting.discard(agent)
        self.hanging.discard(agent)

    def back(self, agent: int) -> None:
        """An agent's token appeared again; it takes part from the next step on."""
        if agent not in self.alive:
            self.alive.add(agent)
            self.hanging.discard(agent)
