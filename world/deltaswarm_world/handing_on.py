"""What the operator has not confirmed yet: an operator that is started anew gets it once more."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

AHEAD_STEPS = 1000
"""The world waits for who has not taken the step so far back: what is kept, and what waits in queues, is bounded."""


class ClosedStep(NamedTuple):
    """What the operator gets of one step: reports as they are handed on, then the clock, all encoded."""

    step: int
    reports: list[bytes]
    clock: bytes
    last: bool = False


Send = Callable[[bytes], None]


class HandingOn:
    """Hands closed steps on to the operator, and keeps those that it has not confirmed to have on disk."""

    def __init__(self, send_report: Send, send_clock: Send) -> None:
        self.confirmed = -1
        """The newest step that the operator has confirmed."""
        self._send_report, self._send_clock = send_report, send_clock
        self._kept: deque[ClosedStep] = deque()

    def close(self, step: ClosedStep, *, now: bool) -> None:
        """A step has been closed; send it now, unless the operator is away."""
        self._kept.append(step)
        if now:
            self._send(step)

    def confirm(self, step: int) -> None:
        """The operator has all up to this step."""
        self.confirmed = max(self.confirmed, step)
        while self._kept and self._kept[0].step <= self.confirmed and not self._kept[0].last:
            self._kept.popleft()

    def begin_anew(self, step: int) -> None:
        """An operator that has all up to this step stands in for another: it gets the others, oldest first.

        One that has all gets the last clock once more, and so knows that it was the last.
        """
        self.confirm(step)
        for kept in self._kept:
            self._send(kept)

    def _send(self, step: ClosedStep) -> None:
        for report in step.reports if step.step > self.confirmed else ():
            self._send_report(report)
        self._send_clock(step.clock)
