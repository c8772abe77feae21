"""Steps that the operator has not confirmed yet; a restarted operator gets them again."""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

AHEAD_STEPS = 200
"""Lead over a part's newest taken step at which the world waits; bounds kept steps and queues."""


class StepMessages(NamedTuple):
    """The operator's messages of one step: forwarded reports, then the clock, all encoded."""

    step: int
    reports: list[bytes]
    clock: bytes
    last: bool = False


Send = Callable[[bytes], None]


class RetransmitBuffer:
    """Forwards closed steps to the operator and keeps them until it confirms them as on disk."""

    def __init__(self, send_report: Send, send_clock: Send) -> None:
        self.confirmed = -1
        """The operator's newest confirmed step."""
        self._send_report, self._send_clock = send_report, send_clock
        self._kept: deque[StepMessages] = deque()

    def add(self, step: StepMessages, *, now: bool) -> None:
        """Keep a closed step; send it `now` unless the operator is away."""
        self._kept.append(step)
        if now:
            self._send(step)

    def confirm(self, step: int) -> None:
        """Drop the steps up to this one, which the operator has."""
        self.confirmed = max(self.confirmed, step)
        while self._kept and self._kept[0].step <= self.confirmed and not self._kept[0].last:
            self._kept.popleft()

    def resend_after(self, step: int) -> None:
        """Send a new operator, which has the steps up to this one, the others, oldest first.

        An operator that has every step gets the last clock again, which tells it that it was the last.
        """
        self.confirm(step)
        for kept in self._kept:
            self._send(kept)

    def _send(self, step: StepMessages) -> None:
        for report in step.reports if step.step > self.confirmed else ():
            self._send_report(report)
        self._send_clock(step.clock)
