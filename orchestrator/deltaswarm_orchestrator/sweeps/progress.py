"""How a sweep goes, for people: a bar with the time left on a terminal, a line now and then on a pipe."""

import sys
import time
from typing import Protocol, Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from deltaswarm_orchestrator.run.progress import BarOnTerminal
from deltaswarm_orchestrator.sweeps.engine import Done

LINE_EVERY_S = 10.0
SPEED_OVER_S = 3600.0
"""Runs are long: the time left is estimated from the last hour."""


class SweepReporter(Protocol):
    """Who is told how a sweep goes."""

    def begin(self, total: int, there: int) -> None:
        """So many runs, of which so many were there already."""

    def done(self, done: Done) -> None:
        """One run has ended."""


class QuietSweep:
    """Tells nobody."""

    def begin(self, total: int, there: int) -> None:
        """Nothing."""

    def done(self, done: Done) -> None:
        """Nothing."""


class SweepDisplay(BarOnTerminal):
    """A bar on a terminal, else lines; as a context manager."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name
        self._began = self._line_due = time.monotonic()
        self._total = self._there = self._ended = self._failed = 0

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._bar = Progress(*columns, console=self._console, speed_estimate_period=SPEED_OVER_S)
            self._task = self._bar.add_task(self._name, total=None)
            self._bar.start()
        return self

    def begin(self, total: int, there: int) -> None:
        """So many runs, of which so many were there already."""
        self._total, self._there = total, there
        if self._bar is not None:
            self._bar.update(self._task, total=total - there)
        if there:
            print(f"{self._name}: {there} of {total} runs are there already", file=sys.stderr, flush=True)

    def done(self, done: Done) -> None:
        """One run has ended."""
        self._ended += 1
        self._failed += done.result is None
        failed = f", {self._failed} failed" if self._failed else ""
        if self._bar is not None:
            self._bar.update(self._task, completed=self._ended, description=f"{self._name}{failed}")
            return
        now = time.monotonic()
        missing = self._total - self._there - self._ended
        if now >= self._line_due or not missing:
            self._line_due = now + LINE_EVERY_S
            left_s = (now - self._began) / self._ended * missing
            text = f"{self._name}: {self._there + self._ended} of {self._total} runs{failed}, {_shown(left_s)} left"
            print(text, file=sys.stderr, flush=True)


def _shown(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"
