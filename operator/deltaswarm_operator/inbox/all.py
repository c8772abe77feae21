"""The policy `all`: every item on a line of its own, at once."""

from collections.abc import Sequence
from typing import Any

from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.policy import NEWEST, Put, alone
from deltaswarm_wire.plugins import NoSettings


class All:
    """Shows everything."""

    Settings = NoSettings
    ORDER = NEWEST
    HELD = ""

    def __init__(self, settings: Any) -> None:
        pass

    def close_step(self, now_s: float, items: Sequence[Item]) -> list[Put]:
        """Show all items."""
        return alone(items)
