"""Measures of a person, simulated or at the station: how busy it was, what it missed, how soon it answered.

`agents_in_turn` is how many agents' items the person could read in turn at the pace at which each agent has some: 1 +
the mean time from the end of an item to the beginning of the next one of the same agent, by the mean time spent on an
item. It has the form of fan-out (Olsen & Wood 2004; Crandall et al. 2005, doi 10.1109/tsmca.2005.850587) but is not
fan-out: the time between items depends on what agents report, and is not the time for which an agent does well
unattended (neglect time).
Commands address the swarm as a whole and count in neither.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import log
from typing import Any

from deltaswarm_operator.inbox.ledger import Ledger

HIGH_LOAD = 0.7
"""Utilisation above which time is counted: people are overloaded beyond it (Donmez, Nehme & Cummings 2010)."""


@dataclass
class Measures:
    """Counts and sums of one run; times are simulated [s]."""

    items: int = 0
    """Each item is read, missed, replaced by a newer item before it was read, or still unread."""
    read: int = 0
    missed: int = 0
    replaced: int = 0
    commands: int = 0
    acknowledge_s: float = 0.0
    time_s: float = 0.0
    busy_s: float = 0.0
    load_s: float = 0.0
    high_s: float = 0.0
    closes: int = 0
    unread_sum: int = 0
    unread_max: int = 0
    interaction_s: float = 0.0
    returns: int = 0
    between_items_s: float = 0.0
    last_s: dict[int, float] = field(default_factory=dict)
    """Time at which the person finished the last item of each agent [s]."""

    def add_load(self, before: float, after: float, passed_s: float, memory_s: float, *, is_busy: bool) -> None:
        """Add time in which the load changed from `before` to `after`: towards 1 if the person was busy, else to 0."""
        goal = float(is_busy)
        self.time_s += passed_s
        self.busy_s += goal * passed_s
        self.load_s += goal * passed_s + memory_s * (before - after)
        was, is_high = before > HIGH_LOAD, after > HIGH_LOAD
        if was and is_high:
            self.high_s += passed_s
        elif was or is_high:
            crossed_s = memory_s * log((before - goal) / (HIGH_LOAD - goal))
            self.high_s += min(max(crossed_s if was else passed_s - crossed_s, 0.0), passed_s)

    def add_unread(self, unread: int) -> None:
        self.closes += 1
        self.unread_sum += unread
        self.unread_max = max(self.unread_max, unread)

    def interact(self, agent: int, began_s: float, ended_s: float) -> None:
        self.interaction_s += ended_s - began_s
        if agent in self.last_s:
            self.returns += 1
            self.between_items_s += began_s - self.last_s[agent]
        self.last_s[agent] = ended_s

    def totals(self, unread: int, isa: float | None) -> dict[str, Any]:
        """Return the metrics of the run so far, for JSON; `unread` items still wait, `isa` is the mean answer."""
        interaction_s = _share(self.interaction_s, self.read)
        between_s = _share(self.between_items_s, self.returns)
        return {
            "utilisation": _share(self.busy_s, self.time_s),
            "load": _share(self.load_s, self.time_s),
            "load_above_0_7_s": self.high_s,
            "items": self.items,
            "read": self.read,
            "missed": self.missed,
            "missed_share": _share(self.missed, self.items),
            "replaced": self.replaced,
            "unread": {"mean": _share(self.unread_sum, self.closes), "max": self.unread_max, "last": unread},
            "acknowledge_s": _share(self.acknowledge_s, self.read),
            "commands": self.commands,
            "isa": isa,
            "interaction_s": interaction_s,
            "between_items_s": between_s,
            "agents_in_turn": between_s / interaction_s + 1 if interaction_s and between_s is not None else None,
        }


class Attention:
    """What the person at the station reads, and how soon: the same measures as a simulated person's.

    An item that is unread for longer than `operator.person.patience_s` is missed, even if it is read later. Times are
    simulated [s]; `wall_s` is any monotonic clock.
    """

    def __init__(self, ledger: Ledger, patience_s: float) -> None:
        self.measures = Measures()
        self.shown_wall_s: dict[int, float] = {}
        """When each item was first sent to the page, by its number."""
        self.read_wall_s: dict[int, float] = {}
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


def _share(total: float, of: float) -> float | None:
    return total / of if of else None
