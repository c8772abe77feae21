"""The policies whose items have lines of their own, at once: `all`, `ranked` by severity and age, `new` ones alone."""

from collections.abc import Sequence
from typing import Any

from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.policy import NEWEST, RANKED, Put, alone
from deltaswarm_scenario.operator_settings import INFO
from deltaswarm_wire.plugins import NoSettings


class All:
    Settings = NoSettings
    ORDER = NEWEST
    HELD = ""

    def __init__(self, settings: Any) -> None:
        pass

    def close_step(self, now_s: float, items: Sequence[Item]) -> list[Put]:
        return alone(items)


class Ranked(All):
    """Shows everything, the most severe items first, and among them the oldest."""

    ORDER = RANKED


class New(All):
    """Shows items above severity info."""

    HELD = "says nothing new"

    def close_step(self, now_s: float, items: Sequence[Item]) -> list[Put]:
        return alone(item for item in items if item.severity != INFO)
