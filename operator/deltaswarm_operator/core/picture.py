"""The operator's picture of the swarm: the sum of the reports that arrived, with its age.

Pure: reports and clock in; positions, roles, trees, events and new items of the inbox out. An agent that no report
mentioned is absent. Everything reported is kept with its time, so it ages; nothing else is made up.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from deltaswarm_operator.inbox.item import MAX_INBOX, Item
from deltaswarm_scenario.operator_settings import (
    CHANGE,
    NEW_EVENT,
    NEW_ROOT,
    REPEAT,
    ROOT_LOST,
    UNHEARD,
    InboxSettings,
)
from deltaswarm_scenario.technique import Seen
from deltaswarm_wire.messages import NOBODY
from deltaswarm_wire.operator_messages import Report

EVENT_MEMORY_S = 300.0
"""Time without reports after which an event is removed [s]."""

MAX_EVENTS = 2000
MAX_NUMBERS = 100_000
"""Maximum number of events whose numbers are remembered: in open air a sender may invent events."""
MAX_TRAIL = 6
"""Maximum number of places of an event that are remembered besides the newest."""
MOVED_M = 0.01
"""An event that is reported this far from its last place has moved."""
MAX_NAMED = 8
"""Maximum number of events in an item."""
NO_EVENTS: frozenset[int] = frozenset()
ROOT, MEMBER, ATTENDING = "root", "member", "attending"
LEFT = "left its tree"
"""Role of an agent that its root no longer names: its present activity is unknown."""


class KnownAgent(NamedTuple):
    """The last known state of an agent. `is_own`: from its own report, else from its root's. `delta`: 0 if unknown."""

    x_m: float
    y_m: float
    role: str
    parent: int
    root: int
    said_s: float
    is_own: bool
    delta: int = 0


class KnownEvent(NamedTuple):
    """An event: its position [m], the times of its first and last report [s], and the last reporter.

    `trail_m`: the places that were reported before, oldest first.
    """

    x_m: float
    y_m: float
    first_s: float
    last_s: float
    by: int
    trail_m: tuple[tuple[float, float], ...] = ()


class Picture:
    """What the operator knows. Times are simulated [s]."""

    def __init__(self, step_s: float, inbox: InboxSettings | None = None) -> None:
        self.go_on_with(inbox or InboxSettings())
        self._unheard: set[int] = set()
        """Agents of which an item says that they are unheard."""
        self.items = 0
        self.agents: dict[int, KnownAgent] = {}
        self.events: dict[int, KnownEvent] = {}
        """By the picture's own numbers; the first reported event is 1."""
        self.closed: dict[int, tuple[float, float]] = {}
        """Times of the first and last report of events that are no longer reported, complete or not [s]."""
        self.now_s = 0.0
        self._step_s = step_s
        self._numbers: dict[int, int] = {}
        """Short numbers of events, in order of their first report: event ids are long and mean nothing."""
        self._told: dict[int, tuple[str, frozenset[int]]] = {}
        """Role and events in each sender's newest report."""
        self._newest_s: dict[int, float] = {}
        """Time of each sender's newest report [s]."""
        self._members: dict[int, set[int]] = {}
        """By root, the agents last known as members of its tree; newer reports may have moved some since."""

    def go_on_with(self, inbox: InboxSettings) -> None:
        self._rules, self._severities = inbox, inbox.severities

    def update(self, reports: Iterable[Report], now_s: float) -> list[Item]:
        """Take in the reports of a closed step; return the new items, even if the inbox is full."""
        self.now_s = now_s
        items = [item for report in reports if (item := self._take(report)) is not None]
        if self._rules.unheard_s:
            items += self._miss()
        oldest_s = now_s - EVENT_MEMORY_S
        for event in [event for event, known in self.events.items() if known.last_s < oldest_s]:
            self._close(event)
        return items

    def _take(self, report: Report) -> Item | None:
        agent, said_s = report.agent, report.step * self._step_s
        if self._newest_s.get(agent, said_s) > said_s:
            return None  # an older report that was delayed
        self._newest_s[agent] = said_s
        self._unheard.discard(agent)
        role_before, before = self._told.get(agent, ("", NO_EVENTS))
        places = {self._number(event): (x_m, y_m) for event, x_m, y_m in report.events}
        is_same_role = report.role == role_before
        item = None
        is_repeat = is_same_role and before.issuperset(places)
        if self._rules.repeats or not is_repeat:
            fresh = tuple(event for event in places if event not in self.events)
            news = REPEAT if is_repeat else _news(fresh, report.role, role_before)
            item = self._item(agent, report.role, report.followers, tuple(places)[:MAX_NAMED], news, fresh)
        if not is_same_role or before != places.keys():
            self._told[agent] = report.role, frozenset(places)
        self._take_tree(report, said_s)
        self._take_events(agent, places, before, said_s)
        return item

    def _number(self, event: int) -> int:
        numbers = self._numbers
        if event not in numbers:
            number = next(reversed(numbers.values()), 0) + 1
            if len(numbers) >= MAX_NUMBERS:
                del numbers[next(iter(numbers))]
            numbers[event] = number
        return numbers[event]

    def _item(
        self,
        agent: int,
        role: str,
        followers: int,
        events: tuple[int, ...],
        news: str,
        fresh: tuple[int, ...] = (),
    ) -> Item:
        told = (agent, role, followers, events, news in (NEW_EVENT, NEW_ROOT), fresh, news, self._severities[news])
        item = Item(min(self.items, MAX_INBOX), self.now_s, *told)
        self.items += 1
        return item

    def _miss(self) -> list[Item]:
        """Return items about the agents that have been silent for too long, in agent order."""
        oldest_s = self.now_s - self._rules.unheard_s
        silent = sorted(agent for agent, said_s in self._newest_s.items() if said_s < oldest_s)
        missed = [agent for agent in silent if agent not in self._unheard]
        self._unheard.update(missed)
        roles = {agent: self._told[agent][0] for agent in missed}
        return [self._item(agent, role, 0, (), ROOT_LOST if role == ROOT else UNHEARD) for agent, role in roles.items()]

    def _take_tree(self, report: Report, said_s: float) -> None:
        """Update positions and trees; agents that their root no longer names have left."""
        root, agents = report.agent, self.agents
        is_root = report.role == ROOT
        members = self._members.get(root)
        if members and (report.members or not is_root or not report.followers):
            for agent in members.difference([member.agent for member in report.members]):
                if (known := agents[agent]).root == root:
                    agents[agent] = known._replace(role=LEFT, parent=NOBODY, root=NOBODY)
            members.clear()
        before = agents.get(root)
        if before is None or before.said_s <= said_s:
            its_root = root if is_root else NOBODY
            agents[root] = KnownAgent(report.x_m, report.y_m, report.role, NOBODY, its_root, said_s, True, report.delta)
        if not report.members:
            return
        members = self._members.setdefault(root, set())
        for agent, parent, x_cm, y_cm in report.members:
            known_member = agents.get(agent)
            if known_member is None or (known_member.said_s, known_member.is_own) <= (said_s, False):
                agents[agent] = KnownAgent(x_cm / 100, y_cm / 100, MEMBER, parent, root, said_s, False)
                members.add(agent)

    def _take_events(
        self, agent: int, places: Mapping[int, tuple[float, float]], before: frozenset[int], said_s: float
    ) -> None:
        events = self.events
        for event in before.difference(places):  # its last reporter no longer reports it
            if (known := events.get(event)) is not None and known.by == agent:
                self._close(event)
        for event, (x_m, y_m) in places.items():
            known = events.get(event)
            if known is None:
                if len(events) < MAX_EVENTS:
                    first_s, _ = self.closed.pop(event, (said_s, said_s))
                    events[event] = KnownEvent(x_m, y_m, first_s, said_s, agent)
            elif known.last_s <= said_s:  # else this report was delayed, and the event has been seen since
                trail_m = known.trail_m
                if abs(x_m - known.x_m) + abs(y_m - known.y_m) > MOVED_M:
                    trail_m = (*trail_m, (known.x_m, known.y_m))[-MAX_TRAIL:]
                events[event] = KnownEvent(x_m, y_m, known.first_s, said_s, agent, trail_m)

    def _close(self, event: int) -> None:
        known = self.events.pop(event)
        self.closed[event] = (known.first_s, known.last_s)
        if len(self.closed) > MAX_NUMBERS:
            del self.closed[next(iter(self.closed))]

    @property
    def closed_after_s(self) -> float | None:
        """Mean time from the first to the last report of events that are no longer reported [s]."""
        if not self.closed:
            return None
        return sum(last_s - first_s for first_s, last_s in self.closed.values()) / len(self.closed)

    @property
    def event_numbers(self) -> Mapping[int, int]:
        """The page's number of each event by its id."""
        return self._numbers

    def seen(self, width_m: float, height_m: float) -> Seen:
        """Return what the page shows, to compare answers about the situation with."""
        places_m = [(known.x_m, known.y_m) for known in self.events.values()]
        return Seen(places_m, [known.root for known in self.agents.values() if known.root != NOBODY], width_m, height_m)

    def rows(self) -> dict[str, list[list[Any]]]:
        """Return agents and events in the page's format; events with the agents that say they attend them."""
        attending: dict[int, list[int]] = {}
        for agent, (_, events) in sorted(self._told.items()):
            for event in events if self.agents[agent].role == ATTENDING else ():
                attending.setdefault(event, []).append(agent)
        return {
            "agents": [
                [agent, round(k.x_m, 2), round(k.y_m, 2), *k[2:5], round(k.said_s, 2), int(k.is_own), k.delta]
                for agent, k in sorted(self.agents.items())
            ],
            "events": [
                [
                    event,
                    *(round(value, 2) for value in k[:4]),
                    k.by,
                    attending.get(event, []),
                    [[round(x_m, 2), round(y_m, 2)] for x_m, y_m in k.trail_m],
                ]
                for event, k in sorted(self.events.items())
            ],
        }


def _news(fresh: tuple[int, ...], role: str, before: str) -> str:
    """Return what a report tells whose sender had another role before, or reported other events."""
    if fresh:
        return NEW_EVENT
    if role != before and ROOT in (role, before):
        return NEW_ROOT if role == ROOT else ROOT_LOST
    return CHANGE
