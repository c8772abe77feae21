"""Steps by a clock: no drift that adds up, and no burst after a delay. All times in s."""

import math


class StepTimer:
    """Step k is due at `start_s + k * step_s`, whatever happened before."""

    def __init__(self, step_s: float, start_s: float) -> None:
        self.skipped = 0
        """Steps that were missed."""
        self._step_s = step_s
        self._start_s = start_s
        self._next = 0

    def wait_s(self, now_s: float) -> float:
        """Until the next step is due; 0 if it is."""
        return max(0.0, self._start_s + self._next * self._step_s - now_s)

    def due(self, now_s: float) -> int | None:
        """The step that is to be done now, once each; None before its time. Late ones are skipped, not made up for."""
        if self.wait_s(now_s) > 0.0:
            return None
        # The next one is due, even where rounding would have its time a hair away; and none is left that is due too.
        step = max(self._next, math.floor((now_s - self._start_s) / self._step_s))
        step += self._start_s + (step + 1) * self._step_s <= now_s
        self.skipped += step - self._next
        self._next = step + 1
        return step
