"""What the operator has not confirmed yet: an operator that is started anew gets it once more."""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

AHEAD_STEPS = 1000
"""The world waits for who has not taken the step so far back: what is kept, and what waits in queues, is bounded."""


class ClosedStep(NamedTuple):
    """What the operator gets of one step: reports as they are handed on, then the clock, all encoded."""

    step: int
    reports: list[bytes]
    clock: bytes


class HandingOn:
    """Closed steps from the oldest that the operator has not confirmed; it confirms what it has on disk."""

    def __init__(self) -> None:
        self.confirmed = -1
        """The newest step that the operator has confirmed."""
        self._steps: deque[ClosedStep] = deque()

    def keep(self, step: ClosedStep) -> None:
        """A step has been closed."""
        self._steps.append(step)

    def confirm(self, step: int) -> None:
        """The operator has all up to this step."""
        self.confirmed = max(self.confirmed, step)
        while self._steps and self._steps[0].step <= self.confirmed:
            self._steps.popleft()

    def unconfirmed(self) -> Iterator[ClosedStep]:
        """What an operator that comes back has not got, oldest first."""
        return iter(tuple(self._steps))
