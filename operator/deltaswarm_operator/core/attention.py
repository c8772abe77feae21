"""What the person at the station reads, and how soon: the same measures as a simulated person's.

Pure. An item that is unread for longer than `operator.person.patience_s` is missed, even if it is read later.
"""

from collections.abc import Iterable
from typing import Any

from deltaswarm_operator.core.measures import Measures
from deltaswarm_operator.inbox.ledger import Ledger


class Attention:
    """Follows the items of one inbox. Times are simulated [s]; `wall_s` is any monotonic clock."""

    def __init__(self, ledger: Ledger, patience_s: float) -> None:
        self.measures = Measures()
        self.shown_wall_s: dict[int, float] = {}
        """When each item was first sent to the page, by its number."""
        self.read_wall_s: dict[int, float] = {}
        """When each item was read."""
        self._ledger = ledger
        self._patience_s = patience_s
        self._sent = 0
        """Number of items that were sent to the page."""
        self._judged = 0
        """Number of items whose time has passed."""

    def show(self, wall_s: float) -> None:
        """Note that all shown items have been sent to the page by now."""
        self.shown_wall_s |= dict.fromkeys(self._ledger.shown[self._sent :], wall_s)
        self._sent = len(self._ledger.shown)

    def read(self, numbers: Iterable[int], now_s: float, wall_s: float) -> None:
        for number in numbers:
            self.read_wall_s[number] = wall_s
            if not (item := self._ledger.items[number]).is_quiet:
                self.measures.read += 1
                self.measures.acknowledge_s += now_s - item.time_s

    def close_step(self, now_s: float) -> None:
        """Count what is unread at the end of a step, and what has become too old since it was shown."""
        ledger = self._ledger
        self.measures.items = len(ledger.listed)
        self.measures.add_unread(ledger.unread)
        while self._judged < len(ledger.listed):
            number = ledger.listed[self._judged]
            if ledger.shown_s[number] >= now_s - self._patience_s:
                break
            self.measures.missed += number not in ledger.read_s
            self._judged += 1

    def totals(self, commands: int, isa: float | None) -> dict[str, Any]:
        """Return the metrics of the run so far, for JSON; what a person does inside is not known: None."""
        self.measures.commands = commands
        return {**self.measures.totals(self._ledger.unread, isa), "load_above_0_7_s": None, "interaction_s": None}
