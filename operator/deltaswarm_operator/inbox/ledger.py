"""The books of an inbox: what a policy shows and holds back, what is read, and when.

Pure. Each item is held back until the policy puts it on a line or the person opens it, so no policy can lose one.
Times are simulated [s].
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from statistics import fmean
from typing import Any, NamedTuple

from deltaswarm_operator.inbox.item import MAX_INBOX, Item, item_row
from deltaswarm_operator.inbox.policy import Policy, Put, policy_of
from deltaswarm_scenario.operator_settings import ALERT, InboxSettings


class Held(NamedTuple):
    items: int
    alerts: int
    oldest_s: float | None


class Ledger:
    """What became of each item of one inbox.

    Args:
        settings: the policy and its options.
        patience_s: an alert that is read later than this after its arrival is missed [s].
    """

    def __init__(self, settings: InboxSettings, patience_s: float) -> None:
        self.items: list[Item] = []
        """All items, with the lines of those that are shown; item n is at index n."""
        self.shown: list[int] = []
        """Numbers of the items in the order in which they were shown."""
        self.listed: list[int] = []
        """Shown items that raise the unread count."""
        self.shown_s: dict[int, float] = {}
        self.read_s: dict[int, float] = {}
        self.opened: set[int] = set()
        """Items that the person opened while they were held back."""
        self._sent = 0
        """Number of listed items that were sent to the page."""
        self._counted: dict[int, list[int]] = {}
        """By line, the items that it only counts; the line that changed last is last."""
        self._held: dict[int, None] = {}
        """Numbers of the items held back, oldest first."""
        self._held_alerts = 0
        self._unread: set[int] = set()
        """Numbers of the listed items that are not read."""
        self._unread_of: Counter[int] = Counter()
        """By line, how many of them it has."""
        self._policy: Policy
        self._offered: list[Item] = []
        """Items held back by an earlier policy, which the present one has not seen."""
        self.go_on_with(settings, patience_s)

    def go_on_with(self, settings: InboxSettings | None, patience_s: float) -> None:
        """Go on with another patience, and perhaps by another policy, which gets what is held back with new items."""
        self._patience_s = patience_s
        if settings is None:
            return
        self._name = settings.policy
        self._policy = policy_of(settings, self.items)
        self._offered = self.held_items

    @property
    def order(self) -> str:
        return self._policy.ORDER

    @property
    def about(self) -> dict[str, str]:
        """What the page is told of the policy."""
        return {"policy": self._name, "order": self._policy.ORDER, "held": self._policy.HELD}

    @property
    def held(self) -> Held:
        oldest = next(iter(self._held), None)
        return Held(len(self._held), self._held_alerts, None if oldest is None else self.items[oldest].time_s)

    @property
    def held_items(self) -> list[Item]:
        """The items held back, oldest first."""
        return [self.items[number] for number in self._held]

    @property
    def unread(self) -> int:
        """Number of lines with unread items."""
        return len(self._unread_of)

    def why_held(self, number: int) -> str:
        """Return why an item was not shown when it arrived; empty if it was."""
        at_once = self.shown_s.get(number) == self.items[number].time_s and number not in self.opened
        return "" if at_once else self._policy.HELD

    def close_step(self, now_s: float, items: Sequence[Item]) -> list[Item]:
        """Take in the new items of a closed step; return those that are shown from now on, with their lines.

        Items for which the inbox has no room are shown at once, without an entry in the books.
        """
        kept = [item for item in items if item.number < MAX_INBOX]
        self.items += kept
        self._held |= dict.fromkeys(item.number for item in kept)
        self._held_alerts += sum(item.severity == ALERT for item in kept)
        offered, self._offered = [*self._offered, *kept], []
        puts = list(self._policy.close_step(now_s, offered))
        return [item for put in puts for item in self._show(put, now_s)] + [*items[len(kept) :]]

    def _show(self, put: Put, now_s: float) -> list[Item]:
        shown = []
        for number in put.items:
            if number in self._held:  # else it was opened before
                del self._held[number]
                item = self.items[number]._replace(line=put.line, is_quiet=put.is_quiet)
                self.items[number] = item
                self._held_alerts -= item.severity == ALERT
                self.shown_s[number] = now_s
                self.shown.append(number)
                if put.is_quiet:
                    counted = self._counted.pop(put.line, [])
                    self._counted[put.line] = counted
                    counted.append(number)
                else:
                    self.listed.append(number)
                    self._unread.add(number)
                    self._unread_of[put.line] += 1
                shown.append(item)
        return shown

    def open(self, numbers: Iterable[int], now_s: float) -> list[int]:
        """Show items that are held back, each on a line of its own; return them."""
        opened = [number for number in numbers if number in self._held]
        self.opened.update(opened)
        for number in opened:
            self._show(Put(number, (number,)), now_s)
        return opened

    def read(self, numbers: Iterable[int], now_s: float) -> list[int]:
        """Mark items as read; return those that were unread. One that was held back is opened by that."""
        fresh = sorted({number for number in numbers if 0 <= number < len(self.items)} - self.read_s.keys())
        self.open(fresh, now_s)
        self.read_s |= dict.fromkeys(fresh, now_s)
        for number in self._unread.intersection(fresh):
            line = self.items[number].line
            self._unread.remove(number)
            self._unread_of[line] -= 1
            if not self._unread_of[line]:
                del self._unread_of[line]
        return fresh

    def rows(self, most: int) -> list[list[Any]]:
        first = max(0, len(self.listed) - most)
        return [item_row(self.items[number], place) for place, number in enumerate(self.listed[first:], first)]

    def new_rows(self, least: int, most: int) -> list[list[Any]]:
        """Return the items listed since the last call in the page's format, and always the newest few."""
        new, self._sent = len(self.listed) - self._sent, len(self.listed)
        return self.rows(min(max(new, least), most))

    def counts(self, most: int) -> list[list[int]]:
        """Return lines and how many items each only counts: those that changed last."""
        return [[line, len(self._counted[line])] for line in islice(reversed(self._counted), most)]

    def on_lines(self, numbers: Iterable[int]) -> list[int]:
        """Return items with those that their lines count, which are read with a line."""
        found = [number for number in numbers if 0 <= number < len(self.items)]
        lines = {self.items[number].line for number in found}
        return [*found, *(number for line in lines for number in self._counted.get(line, ()))]

    def waiting(self, before_s: float) -> int:
        return sum(self.items[number].time_s < before_s for number in self._unread)

    def totals(self, now_s: float) -> dict[str, Any]:
        alerts = [item for item in self.items if item.severity == ALERT]
        due = [item for item in alerts if item.time_s + self._patience_s <= now_s]
        missed = sum(self.read_s.get(item.number, now_s + 1.0) > item.time_s + self._patience_s for item in due)
        return {
            "policy": self._name,
            "items": len(self.items),
            "shown": len(self.shown),
            "lines": len({self.items[number].line for number in self.shown}),
            "held_back": sum(bool(self.why_held(item.number)) for item in self.items),
            "never_shown": len(self._held),
            "opened": len(self.opened),
            "read": len(self.read_s),
            "unread": len(self._unread),
            "shown_after_s": self._mean_wait_s(self.shown_s, self.items),
            "read_after_s": self._mean_wait_s(self.read_s, self.items),
            "alerts": len(alerts),
            "alerts_never_shown": sum(item.number not in self.shown_s for item in alerts),
            "alerts_shown_after_s": self._mean_wait_s(self.shown_s, alerts),
            "alerts_read_after_s": self._mean_wait_s(self.read_s, alerts),
            "alerts_missed": missed,
            "alerts_missed_share": missed / len(due) if due else None,
        }

    @staticmethod
    def _mean_wait_s(moments_s: Mapping[int, float], items: Sequence[Item]) -> float | None:
        waits_s = [moments_s[item.number] - item.time_s for item in items if item.number in moments_s]
        return fmean(waits_s) if waits_s else None

    def by_event(self, numbers: Mapping[int, int]) -> dict[str, dict[int, float]]:
        """Return by event when it was first shown and first read [s]; `numbers` are the page's numbers by event."""
        first_s: dict[str, dict[int, float]] = {"shown_s": {}, "read_s": {}}
        events = {number: event for event, number in numbers.items()}
        for name, moments_s in (("shown_s", self.shown_s), ("read_s", self.read_s)):
            for number, moment_s in moments_s.items():
                for event in map(events.get, (*self.items[number].fresh, *self.items[number].events)):
                    if event is not None:
                        first_s[name][event] = min(moment_s, first_s[name].get(event, moment_s))
        return first_s
