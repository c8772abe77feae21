"""The policy `digest`: one line at a fixed interval, which sums up all items since the last one."""

from collections.abc import Sequence
from dataclasses import dataclass

from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.policy import NEWEST, Put, summed
from deltaswarm_wire.checked import OURS, key


@dataclass(frozen=True)
class DigestSettings:
    every_s: float = key(60.0, "time between two summaries [s]", source=OURS, low=1, high=3600)


class Digest:
    """Shows a summary every `every_s`; without new items there is none."""

    Settings = DigestSettings
    ORDER = NEWEST
    HELD = "waits for the next summary"

    def __init__(self, settings: DigestSettings) -> None:
        self._every_s = settings.every_s
        self._due_s = settings.every_s
        self._waiting: list[Item] = []

    def close_step(self, now_s: float, items: Sequence[Item]) -> list[Put]:
        self._waiting += items
        if now_s < self._due_s - 1e-9:
            return []
        self._due_s += self._every_s * (1 + (now_s - self._due_s) // self._every_s)
        waiting, self._waiting = self._waiting, []
        return summed(waiting) if waiting else []
