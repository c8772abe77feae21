"""Measures of a simulated person: how busy it was, what it missed, how soon it answered.

`agents_in_turn` is how many agents' items the person could read in turn at the pace at which each agent has some: 1 +
the mean time from the end of an item to the beginning of the next one of the same agent, by the mean time spent on an
item. It has the form of fan-out (Olsen & Wood 2004; Crandall et al. 2005, doi 10.1109/tsmca.2005.850587) but is not
fan-out: the time between items depends on what agents report, and is not the time for which an agent does well
unattended (neglect time).
Commands address the swarm as a whole and count in neither.
"""

from dataclasses import dataclass, field
from math import log
from typing import Any

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
        """Add the number of items that wait at the end of a step."""
        self.closes += 1
        self.unread_sum += unread
        self.unread_max = max(self.unread_max, unread)

    def interact(self, agent: int, began_s: float, ended_s: float) -> None:
        """Add the time that the person spent on an item of an agent."""
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


def _share(total: float, of: float) -> float | None:
    return total / of if of else None
