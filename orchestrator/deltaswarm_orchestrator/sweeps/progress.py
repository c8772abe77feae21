"""Show a sweep's progress: a bar with the time left on a terminal, an occasional line on a pipe."""

import sys
import time
from datetime import timedelta

from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

from deltaswarm_orchestrator.run.progress import Bar
from deltaswarm_orchestrator.sweeps.engine import Done

SPEED_OVER_S = 3600.0
"""The time left is estimated from the last hour, because runs are long."""


class SweepReporter:
    """Receives the progress of a sweep. This base class ignores it."""

    def announce(self, total: int, finished: int) -> None:
        """Announce a sweep of `total` runs, `finished` of which were finished before."""

    def count(self, done: Done) -> None:
        """Count a run that has ended."""


class SweepDisplay(Bar, SweepReporter):
    """Shows the progress of a sweep."""

    def __init__(self, name: str) -> None:
        columns = BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
        super().__init__(name, *columns, speed_estimate_period=SPEED_OVER_S)
        self._name = name
        self._began = time.monotonic()
        self._total = self._before = self._ended = self._failed = 0

    def announce(self, total: int, finished: int) -> None:
        """Announce a sweep of `total` runs, `finished` of which were finished before."""
        self._total, self._before = total, finished
        if finished:
            print(f"{self._name}: {finished} of {total} runs are done already", file=sys.stderr, flush=True)

    def count(self, done: Done) -> None:
        """Count a run that has ended."""
        self._ended += 1
        self._failed += done.result is None
        failed = f", {self._failed} failed" if self._failed else ""
        missing = self._total - self._before - self._ended
        left = timedelta(seconds=round((time.monotonic() - self._began) / self._ended * missing))
        self._show(
            f"{self._name}: {self._before + self._ended} of {self._total} runs{failed}, {left} left",
            is_last=not missing,
            brief=f"{self._name}{failed}",
            total=self._total - self._before,
            completed=self._ended,
        )
