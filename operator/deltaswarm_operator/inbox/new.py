"""The policy `new`: only items that tell something new; those of severity info are held back."""

from collections.abc import Sequence

from deltaswarm_operator.inbox.all import All
from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.policy import Put, alone
from deltaswarm_scenario.operator_settings import INFO


class New(All):
    """Shows items above severity info."""

    HELD = "says nothing new"

    def close_step(self, now_s: float, items: Sequence[Item]) -> list[Put]:
        """Show the items above info."""
        return alone(item for item in items if item.severity != INFO)
