"""The lock-step: agents that a step waits for, late agents, lost agents."""

from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass

FORGIVEN_STEPS = 2500
"""After this many steps the backoff with a late agent doubles again, up to its initial value."""

MAX_RETURNS = 20
"""Number of times that an agent, unless it is a board, may come back after its process died."""

MAX_MISSES = 20
"""Maximum number of counted misses; almost no backoff is left then."""


class TimeoutBackoff:
    """Time that a step waits for an agent: half as long after each missed step.

    So an agent that is always late costs a run of n steps at most (2 + n / FORGIVEN_STEPS) times `most_s` [s].
    """

    def __init__(self, most_s: float) -> None:
        self.most_s = most_s
        self._misses: Counter[int] = Counter()
        self._forgiven_at: dict[int, int] = {}
        """The step at which the next miss of an agent is forgiven."""

    def left_s(self, agent: int, step: int) -> float:
        """Return the time that this step may wait for an agent [s]."""
        return self.most_s * 0.5 ** self._counted(agent, step)

    def with_any(self, agents: Collection[int], step: int) -> tuple[float, float]:
        """Return the shortest and the longest time that this step may wait for one of these agents [s]."""
        if not self._misses or not agents:
            return self.most_s, self.most_s
        left_s = [self.left_s(agent, step) for agent in agents]
        return min(left_s), max(left_s)

    def missed(self, agent: int, step: int) -> None:
        """Note that an agent missed this step."""
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
    """A board's attendance in a run."""

    late_steps: int = 0
    """Steps that the board missed while present."""
    absences: int = 0
    """Number of absences."""
    absent_steps: int = 0
    """Steps of absence."""


class LockStep:
    """Keeps the set of agents that a step waits for. It has no clock; the caller has.

    `boards` are agents on machines of their own: they may come and go, and their attendance is counted.
    """

    def __init__(self, agents: Iterable[int], boards: Iterable[int] = ()) -> None:
        self.alive = set(agents)
        """Agents whose process is present."""
        self.waiting: set[int] = set()
        """Agents that got the frame of this step and have not closed it."""
        self.hanging: set[int] = set()
        """Agents that missed a step's end; they get no frame until an act of theirs arrives."""
        self.lost: list[int] = []
        """Agents whose process died without an order, by step, ascending within a step."""
        self._lost_before = 0
        """Number of lost agents at the start of this step."""
        self.returned: set[int] = set()
        """Agents whose process reappeared, until the world handles it."""
        self.frozen: frozenset[int] = frozenset()
        """Frozen agents; they get no frame, and steps do not wait for them."""
        self.boards = {agent: Attendance() for agent in sorted(boards)}
        self.probed: list[int] = []
        """Hung boards to probe: they get the next frame, but the step does not wait for their acts."""
        self._missed: dict[int, int] = {}
        """The step that each hung agent missed: an act for that or a later step ends the hang."""
        self._answers_due: Counter[int] = Counter()
        """Number of frames that boards may still answer: probes, and frames from before an absence."""
        self.step = -1

    def taking_part(self) -> list[int]:
        """Return the present agents that neither hang nor are frozen, ascending."""
        return sorted(self.alive - self.hanging - self.frozen)

    def begin(self, step: int, asked: Iterable[int]) -> None:
        """Open a step, in which these agents get a frame."""
        self.step = step
        self._lost_before = len(self.lost)
        self.waiting = set(asked)
        for agent, attendance in self.boards.items():
            attendance.absent_steps += agent not in self.alive

    def unanswered(self, agent: int) -> int:
        """Return the number of an agent's frames without an act."""
        return (agent in self.waiting) + (agent in self.hanging) + self._answers_due[agent]

    def close(self, agent: int, step: int) -> bool:
        """Take an act; return whether it closes the agent's step."""
        if agent in self.waiting and step == self.step:
            self.waiting.discard(agent)
            self._answers_due.pop(agent, None)  # it answers in order: what is still due was lost
            return True
        return False

    def answer_late(self, agent: int, step: int) -> bool:
        """Take an act that closes no step; return whether it was still due, as from a hung agent."""
        if agent in self.hanging and step >= self._missed[agent]:
            self.hanging.discard(agent)
            return True
        if self._answers_due[agent]:
            self._answers_due[agent] -= 1
            return True
        return False

    @property
    def is_closed(self) -> bool:
        """Whether the step waits for no agent."""
        return not self.waiting

    def give_up(self) -> list[int]:
        """Continue without the awaited agents, which count as hung until their next act; return them."""
        late = sorted(self.waiting)
        self.hanging |= self.waiting
        self._missed |= dict.fromkeys(late, self.step)
        for agent in self.hanging & self.boards.keys():
            self.boards[agent].late_steps += 1
        self.waiting = set()
        return late

    def probe(self) -> None:
        """Schedule a frame for hung boards in the next step."""
        self.probed = sorted(self.hanging & self.boards.keys())
        self._answers_due.update(self.probed)

    def gone(self, agent: int) -> None:
        """Note that an agent's liveliness token disappeared."""
        if agent in self.alive:
            if agent in self.boards and agent in self.waiting | self.hanging:
                self._answers_due[agent] += 1  # its process may be well, and answer once its link is back
            self.alive.discard(agent)
            self.waiting.discard(agent)
            self.hanging.discard(agent)
            if agent not in self.boards:
                self.lost[self._lost_before :] = sorted([*self.lost[self._lost_before :], agent])
            elif self.step >= 0:
                self.boards[agent].absences += 1

    def take_out(self, agent: int) -> None:
        """Remove an agent killed by an order, which does not count as lost."""
        self.alive.discard(agent)
        self.waiting.discard(agent)
        self.hanging.discard(agent)

    def back(self, agent: int) -> None:
        """Note that an agent's token reappeared; it takes part from the next step on, unless it died too often."""
        if agent not in self.alive and self.lost.count(agent) <= MAX_RETURNS:
            self.alive.add(agent)
            self.returned.add(agent)
            self.hanging.discard(agent)
