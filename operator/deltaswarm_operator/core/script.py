"""A script at the console: commands by the time at which each leaves the base. Pure."""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from deltaswarm_scenario.operator_links import CommandSettings


class Scripted(NamedTuple):
    command: CommandSettings
    is_dropped: bool = False
    """It is not given; its number is left out, so that later commands keep theirs."""
    number: int | None = None
    """Its number in the run whose script is followed; a console that has given it already does not give it again."""


class Script:
    def __init__(self, commands: Iterable[Scripted], step_s: float) -> None:
        self._waiting = deque(sorted(commands, key=lambda scripted: scripted.command.at_s))
        self._step_s = step_s

    def due(self, step: int) -> Scripted | None:
        """Return the next command if it leaves in this step, or should have before; `take` it once it is given."""
        first = self._waiting[0] if self._waiting else None
        return first if first is not None and round(first.command.at_s / self._step_s) <= step else None

    def take(self) -> None:
        self._waiting.popleft()
