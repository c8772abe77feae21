"""The operator's turns: which commands leave the base in which step, and whether a step may begin without a turn.

A scripted or simulated operator is waited for: what it says after the clock of step k leaves the base in step k + 2, so
that its answer overlaps a step. A person is not: a command leaves in the step that begins next, which is noted, so that
a script can repeat the run.
"""

from collections import deque
from typing import Any

from deltaswarm_wire.commands import MAX_IN_TURN, Signed, Turn, decode_command
from deltaswarm_wire.settings_downlink import FIRST_STEP

OFF, AWAITED, LIVE = "off", "awaited", "live"

MAX_WAITING = 256
"""Commands of a person that wait for the next step."""


class Turns:
    """The operator's part in the lock-step."""

    def __init__(self, mode: str = OFF) -> None:
        self.mode = mode
        self.newest = -1
        """The newest step whose turn has come."""
        self.log: list[dict[str, Any]] = []
        """The commands that left the base, as the scenario has them, with their steps."""
        self._waiting: deque[tuple[int, Signed]] = deque()
        """With the least step in which each may leave."""

    def take(self, turn: Turn) -> str | None:
        """Take in a turn; the reason if it is dropped."""
        if self.mode == OFF:
            return "turn: the scenario has no operator that commands"
        if self.mode == AWAITED and turn.step <= self.newest:
            return None  # of an operator that stands in for one that was killed, and says it again
        if len(self._waiting) + len(turn.commands) > MAX_WAITING:
            return f"turn: at most {MAX_WAITING} commands may wait for a step"
        self.newest = max(self.newest, turn.step)
        leaves = turn.step + FIRST_STEP if self.mode == AWAITED else FIRST_STEP
        self._waiting += [(leaves, signed) for signed in turn.commands]
        return None

    def is_due(self, step: int) -> bool:
        """Whether a step may begin: what the operator says to the step before the last is known."""
        return self.mode != AWAITED or self.newest >= step - FIRST_STEP

    def leaving(self, step: int, step_s: float) -> list[Signed]:
        """The commands that leave the base in this step, in the order in which they were given.

        No more than a script's turn has room for: what a person gave during a pause must be repeatable.
        """
        leaving: list[Signed] = []
        while self._waiting and self._waiting[0][0] <= step and len(leaving) < MAX_IN_TURN:
            _, signed = self._waiting.popleft()
            leaving.append(signed)
            command = decode_command(signed.body)
            self.log.append(
                {
                    "at_s": step * step_s,
                    "name": command.name,
                    "target": command.target.kind,
                    "numbers": list(command.target.numbers),
                    "arguments": command.arguments,
                    "life_s": command.life_s,
                }
            )
        return leaving
