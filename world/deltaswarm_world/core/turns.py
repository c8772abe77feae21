"""The operator's turns: which commands leave the base in which step, and whether a step may begin without a turn.

The world waits for a scripted or simulated operator: its commands after the clock of step k leave the base in step
k + 2, so that its answer overlaps a step. The world does not wait for a person: a command leaves in the step that
begins next, which is logged, so that a script can repeat the run.
"""

from collections import deque
from typing import Any

from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_wire.commands import MAX_IN_TURN, Signed, Turn, decode_command

OFF, AWAITED, LIVE = "off", "awaited", "live"

MAX_WAITING = 256
"""Maximum number of commands that wait for a step."""


class Turns:
    """The operator's part in the lock-step."""

    def __init__(self, mode: str = OFF) -> None:
        self.mode = mode
        self.newest = -1
        """The newest step whose turn has arrived."""
        self.log: list[dict[str, Any]] = []
        """The commands that left the base, as scenario entries with their times."""
        self._waiting: deque[tuple[int, Signed]] = deque()
        """Waiting commands, each with the first step in which it may leave."""

    def accept(self, turn: Turn) -> str | None:
        """Take in a turn; return the reason if it is dropped."""
        if self.mode == OFF:
            return "turn: the scenario has no operator that commands"
        if self.mode == AWAITED and turn.step <= self.newest:
            return None  # repeated by an operator that replaces a killed one
        if len(self._waiting) + len(turn.commands) > MAX_WAITING:
            return f"turn: at most {MAX_WAITING} commands may wait for a step"
        self.newest = max(self.newest, turn.step)
        leaves = turn.step + FIRST_STEP if self.mode == AWAITED else FIRST_STEP
        self._waiting += [(leaves, signed) for signed in turn.commands]
        return None

    def withdraw(self, number: int) -> None:
        self._waiting = deque(
            [waiting for waiting in self._waiting if decode_command(waiting[1].body).number != number]
        )

    def is_due(self, step: int) -> bool:
        """Whether a step may begin: an awaited operator's turn for the step before the last has come."""
        return self.mode != AWAITED or self.newest >= step - FIRST_STEP

    @property
    def next_leaving_step(self) -> int | None:
        """The first step in which a command that waits may leave; None if none waits."""
        return self._waiting[0][0] if self._waiting else None

    def leaving(self, step: int, step_s: float) -> list[Signed]:
        """Take and log the commands that leave the base in this step, in the order given.

        At most as many leave as fit into a script's turn: a person's commands during a pause must be repeatable.
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
