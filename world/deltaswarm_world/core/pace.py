"""When a step begins and ends on the wall clock: by `realtime`, the operator's turn and pace, and agents' time-outs.

The caller has the clock and waits.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection

from deltaswarm_wire.commands import Pace
from deltaswarm_world.core.turns import Turns


class RealTimePace:
    """Holds each step until the end of its tick; a longer step is counted, not made up for.

    `monotonic` returns the wall time [s], as in the module `time`; `complain` gets a text when the pace is first lost.
    """

    def __init__(
        self,
        tick_s: float,
        monotonic: Callable[[], float],
        complain: Callable[[str], None],
    ) -> None:
        self.overruns = 0
        """Steps that began more than one tick late."""
        self._tick_s = tick_s
        self._monotonic = monotonic
        self._complain = complain
        self.tick_ends_s = monotonic()
        """The wall time at which the step's tick ends."""

    def next_tick(self) -> float:
        """Begin a step; return the wall time [s] at which it must end.

        A delay of up to one tick shortens this step. After a longer delay ticks count from now, to avoid a burst of
        steps.
        """
        now_s = self._monotonic()
        if now_s > self.tick_ends_s + self._tick_s:
            self.overruns += 1
            if self.overruns == 1:
                self._complain(f"the machine cannot hold the pace of one step per {self._tick_s:g} s")
            self.tick_ends_s = now_s
        self.tick_ends_s += self._tick_s
        return self.tick_ends_s

    def pause(self, seconds: float) -> None:
        self.tick_ends_s += seconds


class StepGate:
    """Holds steps back until the operator's turn has come and its pace allows them.

    `monotonic` tells the wall time [s], as in the module `time`. The pace changes no result: it makes no agent late.
    """

    def __init__(self, turns: Turns, step_s: float, monotonic: Callable[[], float]) -> None:
        self._turns = turns
        self._step_s = step_s
        self._monotonic = monotonic
        self._pace = Pace(0.0, -1)
        self._last_begin_s = -math.inf

    def set_pace(self, pace: Pace) -> None:
        self._pace = pace

    def may_begin(self, step: int) -> bool:
        return not self._is_held(step) and self._turns.is_due(step) and self._monotonic() >= self._due_s()

    def wait_s(self, step: int) -> float | None:
        """Return the time to wait before asking again [wall s]; None if only the operator's turn is missing."""
        if self._is_held(step):
            return math.inf
        left_s = self._due_s() - self._monotonic()
        return max(0.0, left_s) if self._turns.is_due(step) else None

    def begin_step(self) -> None:
        """Note that a step begins; the next one is due a tick later."""
        now_s = self._monotonic()
        due_s = self._due_s()
        self._last_begin_s = due_s if now_s - due_s <= self._tick_s() else now_s

    def _is_held(self, step: int) -> bool:
        return 0 <= self._pace.hold_step <= step

    def _tick_s(self) -> float:
        return self._step_s / self._pace.speed if self._pace.speed else 0.0

    def _due_s(self) -> float:
        return self._last_begin_s + self._tick_s()


FORGIVEN_STEPS = 2500
"""After this many steps the backoff with a late agent doubles again, up to its initial value."""

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
        return self.most_s * 0.5 ** self._counted(agent, step)

    def with_any(self, agents: Collection[int], step: int) -> tuple[float, float]:
        """Return the shortest and the longest time that this step may wait for one of these agents [s]."""
        if not self._misses or not agents:
            return self.most_s, self.most_s
        left_s = [self.left_s(agent, step) for agent in agents]
        return min(left_s), max(left_s)

    def missed(self, agent: int, step: int) -> None:
        if not self._counted(agent, step):
            self._forgiven_at[agent] = step + FORGIVEN_STEPS
        self._misses[agent] = min(self._misses[agent] + 1, MAX_MISSES)

    def _counted(self, agent: int, step: int) -> int:
        while self._misses[agent] and step >= self._forgiven_at[agent]:
            self._misses[agent] -= 1
            self._forgiven_at[agent] += FORGIVEN_STEPS
        return self._misses[agent]
