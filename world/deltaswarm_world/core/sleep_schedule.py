"""The sleep schedule: which agents have something to decide, and the positions of the others meanwhile."""

from collections import deque
from collections.abc import Collection, Sequence
from itertools import islice

from deltaswarm_wire.messages import MAX_POSES, Act, Event, Heard, Pose


class SleepSchedule:
    """Keeps until when each agent's last act holds, and the step of its last frame."""

    def __init__(self, agents: int, *, ask_all: bool) -> None:
        self._ask_all = ask_all
        self._until = [0] * agents
        self._asked = [-1] * agents
        self._sensed: set[int] = set()
        """Agents that sensed something in the last step, for which sensing nothing is news."""
        self._places: deque[list[Pose]] = deque(maxlen=MAX_POSES)
        """All agents' positions in the last steps, this one last."""

    def wake(self, agent: int) -> None:
        """Give an agent a frame in the next step, whatever its last act said."""
        self._until[agent] = 0

    def start(self, agent: int, step: int) -> None:
        """Start a new process of an agent with this step, without the positions before."""
        self._until[agent] = 0
        self._asked[agent] = step - 1

    def hold(self, agent: int, act: Act) -> None:
        """Let an act hold until its step, at most as long as a frame has room for positions."""
        self._until[agent] = min(act.until, act.step + MAX_POSES)

    def due(
        self,
        step: int,
        agents: Sequence[int],
        sensed: Sequence[Sequence[Event]],
        heard: Sequence[Sequence[Heard]],
        always: Collection[int],
    ) -> list[int]:
        """Return the agents whose act has run out, that sense or hear something, or are in `always`.

        An agent that sensed something in the step before is asked once more. `sensed` and `heard` are by agent.
        """
        before, self._sensed = self._sensed, {agent for agent in agents if sensed[agent]}
        if self._ask_all:
            return list(agents)
        until, news = self._until, before | self._sensed
        return [agent for agent in agents if until[agent] <= step or agent in news or heard[agent] or agent in always]

    def move_to(self, places: Sequence[Sequence[float]]) -> None:
        """Note all agents' positions in this step [m]."""
        self._places.append([(x_m, y_m) for x_m, y_m in places])

    def ask(self, agent: int, step: int) -> tuple[Pose, tuple[Pose, ...]]:
        """Return an agent's position in this step, and those since its last frame, oldest first."""
        places = self._places
        missed = min(step - self._asked[agent], len(places)) - 1
        self._asked[agent] = step
        here = places[-1][agent]
        if missed <= 0:
            return here, ()
        last = len(places) - 1
        return here, tuple([there[agent] for there in islice(places, last - missed, last)])
