"""An item of the inbox: a message of the swarm with what it tells and how much it matters."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from deltaswarm_scenario.operator_settings import CHANGE, INFO
from deltaswarm_wire.messages import NOBODY

MAX_INBOX = 100_000


class Item(NamedTuple):
    """One item of the inbox: a report, usually with something that its sender had not reported before.

    Attributes:
        is_new: whether the report names an event that the picture lacks, or its sender has become a root.
        fresh: the events that the picture lacked.
        news: what the item tells (`operator_settings.NEWS`).
        severity: how much it matters, by `operator.inbox`.
        line: the line of the inbox that it is shown on, by the number of the first item on it; NOBODY: one of its own.
        is_quiet: whether its line only counts it, and does not ask to be read for it.
    """

    number: int
    time_s: float
    agent: int
    role: str
    followers: int
    events: tuple[int, ...]
    is_new: bool
    fresh: tuple[int, ...] = ()
    news: str = CHANGE
    severity: str = INFO
    line: int = NOBODY
    is_quiet: bool = False

    def __deepcopy__(self, memo: Mapping[int, Any]) -> "Item":
        return self


def item_row(item: Item, place: int) -> list[Any]:
    """Return an item in the page's format, with its place in the order in which items were shown; -1: it is not."""
    line = item.number if item.line == NOBODY else item.line
    return [*item[:5], list(item.events), int(item.is_new), item.severity, line, place]
