"""Tells from one agent's sequence numbers whether its process restarts or several processes run at the same time.

Pure. A process counts up by ones and takes a while to restart. If numbers repeatedly fall back at once to an earlier
sequence, a second process has the same agent's number.
"""

import math
from dataclasses import dataclass

RESTART_S = 1.5
"""Shortest restart of a board: systemd waits for 2 s."""

RETURNS = 8
"""After this many returns to an earlier sequence without a restart, several processes run at the same time."""

ALONE = 100
"""After this many reports in order there is only one process again."""

MAX_PROCESSES = 32
"""Maximum number of processes; the least recent are forgotten."""


@dataclass
class TrackedProcess:
    """One process: its newest number, and the number of reports that seem lost before it."""

    newest: int
    lost: int = 0


class ProcessTracker:
    """Distinguishes processes by the sequence numbers of their reports in order of arrival."""

    def __init__(self) -> None:
        self.lost = 0
        """Missing reports of all processes."""
        self.restarts = 0
        """Number of restarts."""
        self.is_doubled = False
        """Whether several processes run at the same time."""
        self.was_doubled = False
        self._processes: list[TrackedProcess] = []
        """In order of their latest report."""
        self._heard_s = -math.inf
        self._returns = 0
        self._in_order = 0

    def hear(self, sequence: int, now_s: float) -> None:
        """Take a report that is no copy.

        A number one above a process's newest continues that process, so nothing counts as lost while two processes
        alternate. A larger number means lost reports or another process: it continues the latest process until that
        one continues itself.
        """
        processes = self._processes
        went_back = bool(processes) and sequence <= processes[-1].newest
        is_soon = now_s - self._heard_s < RESTART_S
        below = [process for process in processes if process.newest < sequence]
        before = next((process for process in reversed(below) if process.newest == sequence - 1), None)
        if before is not None:
            self.lost -= before.lost
            processes.remove(before)
        elif below and (is_soon or not went_back):
            before = max(below, key=lambda process: process.newest) if self._returns or went_back else processes[-1]
            self.lost += sequence - before.newest - 1 - before.lost
            before.lost = sequence - before.newest - 1
        elif processes:
            self.restarts += 1
            self._returns = 0
        processes.append(TrackedProcess(sequence))
        del processes[:-MAX_PROCESSES]
        self._heard_s = now_s
        self._returns += went_back and is_soon and before is not None
        self._in_order = 0 if went_back else self._in_order + 1
        if self._in_order >= ALONE:
            self._returns, self.is_doubled = 0, False
        elif self._returns >= RETURNS:
            self.is_doubled = self.was_doubled = True
