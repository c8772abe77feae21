"""Steps by a clock, without accumulated drift and without bursts after a delay. All times in s."""

import math


class StepTimer:
    """Step k is due at `start_s + k * step_s`, independent of earlier delays."""

    def __init__(self, step_s: float, start_s: float) -> None:
        self.skipped = 0
        """Number of missed steps."""
        self._step_s = step_s
        self._start_s = start_s
        self._next = 0

    def wait_s(self, now_s: float) -> float:
        """Return the time until the next step is due [s]; 0 if it is due."""
        return max(0.0, self._start_s + self._next * self._step_s - now_s)

    def due(self, now_s: float) -> int | None:
        """Return the step that is due, each once; None if none is due. Late steps are skipped, not made up for."""
        if self.wait_s(now_s) > 0.0:
            return None
        # The next step is due, even if rounding puts it slightly later; skip to the newest step that is due.
        step = max(self._next, math.floor((now_s - self._start_s) / self._step_s))
        step += self._start_s + (step + 1) * self._step_s <= now_s
        self.skipped += step - self._next
        self._next = step + 1
        return step
