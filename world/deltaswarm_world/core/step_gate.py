"""When the next step may begin, as the operator wants it: its turn, its pace, its pauses. The clock is the caller's."""

import math
from collections.abc import Callable

from deltaswarm_wire.commands import Pace
from deltaswarm_world.core.turns import Turns


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
        """The operator wants another pace."""
        self._pace = pace

    def may_begin(self, step: int) -> bool:
        """Whether a step may begin now."""
        return not self._is_held(step) and self._turns.is_due(step) and self._monotonic() >= self._due_s()

    def wait_s(self, step: int) -> float | None:
        """How long to wait before asking again [wall s]; None where only the operator's turn is lacking."""
        if self._is_held(step):
            return math.inf
        left_s = self._due_s() - self._monotonic()
        return max(0.0, left_s) if self._turns.is_due(step) else None

    def begin_step(self) -> None:
        """A step begins: the next one is due after its share of the wall's time."""
        now_s = self._monotonic()
        due_s = self._due_s()
        self._last_begin_s = due_s if self._pace.speed and now_s - due_s <= self._tick_s() else now_s

    def _is_held(self, step: int) -> bool:
        return 0 <= self._pace.hold_step <= step

    def _tick_s(self) -> float:
        return self._step_s / self._pace.speed if self._pace.speed else 0.0

    def _due_s(self) -> float:
        return self._last_begin_s + self._tick_s()
