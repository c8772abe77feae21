"""The policy `grouped`: one line per event or tree, which counts its items and is updated in place."""

from collections.abc import Sequence
from typing import Any

from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.policy import NEWEST, Put
from deltaswarm_scenario.operator_settings import INFO
from deltaswarm_wire.plugins import NoSettings


class Grouped:
    """Puts an item on the line of its first new event, else of an event that has a line, else of its sender.

    Events that one item names first share its line. An item of severity info on a line that exists is only counted.
    """

    Settings = NoSettings
    ORDER = NEWEST
    HELD = ""

    def __init__(self, settings: Any) -> None:
        self._line_of_event: dict[int, int] = {}
        self._line_of_sender: dict[int, int] = {}

    def close_step(self, now_s: float, items: Sequence[Item]) -> list[Put]:
        return [self._put(item) for item in items]

    def _put(self, item: Item) -> Put:
        known = [self._line_of_event[event] for event in item.events if event in self._line_of_event]
        if item.fresh or (item.events and not known):
            line = item.number
        elif known:
            line = known[0]
        else:
            line = self._line_of_sender.setdefault(item.agent, item.number)
        for event in item.fresh:  # an event that returns begins a new line
            self._line_of_event[event] = line
        for event in item.events:
            self._line_of_event.setdefault(event, line)
        return Put(line, (item.number,), is_quiet=item.severity == INFO and line != item.number)
