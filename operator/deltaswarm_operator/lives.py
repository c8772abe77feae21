"""The processes behind one agent's sequence numbers: one that begins anew again and again, or two at the same time.

Pure. A process counts up by ones, and needs a while to begin anew. So where numbers fall back at once, and not to a
beginning, again and again, a second process has the same agent's number.
"""

import math
from dataclasses import dataclass

RESTART_S = 1.5
"""No board is back sooner: systemd waits for 2 s."""

RETURNS = 8
"""So often did one go on that seemed to be over, and none began between: they are there at the same time."""

ALONE = 100
"""So many reports in order, and it is one process again."""

MAX_LIVES = 32
"""Those that were not heard for longest are forgotten."""


@dataclass
class Life:
    """One process, as far as it is known: its newest number, and how many seem to be lost behind that."""

    newest: int
    lost: int = 0


class Lives:
    """Tells processes apart by the sequence numbers of their reports, in the order in which those come."""

    def __init__(self) -> None:
        self.lost = 0
        """Reports that are missing in the count of any."""
        self.restarts = 0
        """How often one began after another."""
        self.is_doubled = False
        """Whether two or more are there at the same time."""
        self.was_doubled = False
        self._lives: list[Life] = []
        """Whoever was heard last is the last one."""
        self._heard_s = -math.inf
        self._returns = 0
        self._in_order = 0

    def hear(self, sequence: int, now_s: float) -> None:
        """Take in a report that is no copy of one that came.

        Who goes on by one is known by that, and so nothing is lost while two alternate. A number that grew by more is
        that of a process that lost some, or of another one: of the first until that one goes on.
        """
        lives = self._lives
        went_back = bool(lives) and sequence <= lives[-1].newest
        is_soon = now_s - self._heard_s < RESTART_S
        below = [life for life in lives if life.newest < sequence]
        before = next((life for life in reversed(below) if life.newest == sequence - 1), None)
        if before is not None:
            self.lost -= before.lost
            lives.remove(before)
        elif below and (is_soon or not went_back):
            before = max(below, key=lambda life: life.newest) if self._returns or went_back else lives[-1]
            self.lost += sequence - before.newest - 1 - before.lost
            before.lost = sequence - before.newest - 1
        elif lives:
            self.restarts += 1
            self._returns = 0
        lives.append(Life(sequence))
        del lives[:-MAX_LIVES]
        self._heard_s = now_s
        self._returns += went_back and is_soon and before is not None
        self._in_order = 0 if went_back else self._in_order + 1
        if self._in_order >= ALONE:
            self._returns, self.is_doubled = 0, False
        elif self._returns >= RETURNS:
            self.is_doubled = self.was_doubled = True
