"""The simulated operator: one server with one queue, whose speed depends on its load (sources: `docs/OPERATOR.md`).

Pure: the new items of a closed step, its time and the message rate in; acts out. All times are simulated [s].

An overloaded person with the policy `threshold` changes delta. In the paper (Sensitivity to delta, figure 5) delta 10
behaves as decentralised control. A smaller delta is more centralised and sends the operator fewer messages, down to
delta 3; below 3 there are more roots, which report more. Here delta 5 sends the fewest messages. So the right direction
and limit of the change are not obvious: the settings `delta_step` and `delta_limit` give them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp
from random import Random
from typing import Any, NamedTuple

from deltaswarm_operator.core.autonomy import first_delta, next_delta
from deltaswarm_operator.core.measures import Measures
from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.policy import urgency
from deltaswarm_scenario.operator_settings import NEW_FIRST, Briefing, PersonSettings
from deltaswarm_wire.messages import NOBODY


class Read(NamedTuple):
    """The person has read an item; `numbers` also has the items that it replaced."""

    numbers: tuple[int, ...]


class SetDelta(NamedTuple):
    delta: int


Act = Read | SetDelta


@dataclass
class _Entry:
    """A line of the inbox that waits to be read, for `item`; `numbers` are the items that are read with it.

    `more` further items on the line ask to be read; the newest of them was shown at `shown_s`.
    """

    line: int
    item: Item
    numbers: list[int]
    shown_s: float
    more: int = 0

    def join(self, item: Item, now_s: float) -> None:
        self.numbers.append(item.number)
        self.more += 1
        self.item, self.shown_s = _with_news(self.item, item), now_s


def _with_news(item: Item, other: Item) -> Item:
    """Return an item that matters as much as both."""
    severity = min(item, other, key=urgency).severity
    return item._replace(is_new=item.is_new or other.is_new, severity=severity)


@dataclass
class _Job:
    began_s: float
    ends_s: float
    entry: _Entry | None
    delta: int = 0


@dataclass
class SimulatedOperator:
    """One simulated person.

    Args:
        settings: the person's parameters.
        rng: the person's own generator; a copy of the person has a copy of it.
        threshold_hz: the message rate to stay below [1/s].
        delta: the swarm's initial delta; None if the controller takes no delta.
    """

    settings: PersonSettings
    rng: Random
    threshold_hz: float
    delta: int | None = None
    is_ranked: bool = False
    """Whether lines are read in the order of `policy.urgency`."""
    load: float = 0.0
    """The utilisation state x, from 0 to 1."""
    measures: Measures = field(default_factory=Measures)
    _now_s: float = 0.0
    _rate_hz: float | None = None
    _waiting: list[_Entry] = field(default_factory=list)
    _job: _Job | None = None
    _commanded_s: float | None = None
    _first_delta: int | None = None

    def __post_init__(self) -> None:
        self._first_delta = self.delta

    @property
    def unread(self) -> int:
        """Number of waiting items, including the item being read."""
        return len(self._waiting) + (self._job is not None and self._job.entry is not None)

    def live(self, now_s: float, items: Sequence[Item], rate_hz: float) -> list[Act]:
        """Advance to the end of a step, then take in its items and rate; return the acts completed by then."""
        acts: list[Act] = []
        while True:
            if self._job is None:
                self._job = self._begin()
            if self._job is None or self._job.ends_s > now_s:
                break
            self._pass(self._job.ends_s)
            acts.append(self._finish(self._job))
            self._job = None
        self._pass(now_s)
        for item in items:
            self._take(item)
        self._renege()
        self._rate_hz = rate_hz
        self.measures.add_unread(self.unread)
        return acts

    def totals(self, isa: float | None = None) -> dict[str, Any]:
        """Return the metrics of the run so far, for JSON; `isa` is the mean answer to ISA."""
        return self.measures.totals(self.unread, isa)

    def go_on_with(self, settings: PersonSettings, threshold_hz: float, *, is_ranked: bool) -> None:
        """Go on with other parameters; a command that is being given is given up if the person commands no more."""
        self.settings, self.threshold_hz, self.is_ranked = settings, threshold_hz, is_ranked
        if not settings.commands and self._job is not None and self._job.entry is None:
            self._job = None

    # Time

    def _pass(self, until_s: float) -> None:
        """Advance through time in which the person is always busy or always idle: dx/dt = (busy - x) / memory_s."""
        passed_s = until_s - self._now_s
        if passed_s <= 0:
            return
        is_busy = self._job is not None
        before, goal = self.load, float(is_busy)
        self.load = goal + (before - goal) * exp(-passed_s / self.settings.memory_s)
        self.measures.add_load(before, self.load, passed_s, self.settings.memory_s, is_busy=is_busy)
        self._now_s = until_s

    def _duration_s(self, median_s: float) -> float:
        settings = self.settings
        away = (self.load - settings.best_load) / (1 - settings.best_load)
        return median_s * exp(settings.sigma * self.rng.gauss(0.0, 1.0)) * (1 + settings.slowing * away**2)

    # Work

    def _begin(self) -> _Job | None:
        """Begin the next work: commands before reading, new items before known ones, oldest items first."""
        settings = self.settings
        delta = self._wanted_delta()
        if delta is not None:
            return _Job(self._now_s, self._now_s + self._duration_s(settings.command_s), None, delta)
        self._renege()
        if not self._waiting:
            return None
        entry = min(self._waiting, key=self._priority)
        self._waiting.remove(entry)
        median_s = (settings.new_s if entry.item.is_new else settings.known_s) + settings.more_s * entry.more
        return _Job(self._now_s, self._now_s + self._duration_s(median_s), entry)

    def _priority(self, entry: _Entry) -> tuple[int, int]:
        if self.is_ranked:
            return urgency(entry.item)
        return self.settings.reads == NEW_FIRST and not entry.item.is_new, entry.item.number

    def _finish(self, job: _Job) -> Act:
        if job.entry is None:
            self.delta, self._commanded_s = job.delta, job.ends_s
            self.measures.commands += 1
            return SetDelta(job.delta)
        item = job.entry.item
        self.measures.read += 1
        self.measures.acknowledge_s += job.ends_s - item.time_s
        self.measures.interact(item.agent, job.began_s, job.ends_s)
        return Read(tuple(job.entry.numbers))

    def _wanted_delta(self) -> int | None:
        settings, first = self.settings, self._first_delta
        if not settings.commands or self.delta is None or first is None or self._rate_hz is None:
            return None
        if self._commanded_s is not None and self._now_s - self._commanded_s < settings.command_every_s:
            return None
        is_high = self._rate_hz > self.threshold_hz
        is_low = self._rate_hz < settings.relief * self.threshold_hz
        change = {"step": settings.delta_step, "limit": settings.delta_limit}
        return next_delta(self.delta, first, is_high=is_high, is_low=is_low, **change)

    # The queue

    def _take(self, item: Item) -> None:
        """Add an item to its line; alone on a line, it replaces waiting items of its sender that name no other event.

        What a line only counts is read with it.
        """
        line = item.number if item.line == NOBODY else item.line
        waiting = next((entry for entry in self._waiting if entry.line == line), None)
        if item.is_quiet:
            if waiting is not None:
                waiting.numbers.append(item.number)
            return
        self.measures.items += 1
        if waiting is not None:
            waiting.join(item, self._now_s)
            self.measures.replaced += 1
            return
        entry = _Entry(line, item, [item.number], self._now_s)
        for other in [other for other in self._waiting if other.item.agent == item.agent and not other.more]:
            if set(other.item.events) <= set(item.events):
                self._waiting.remove(other)
                self.measures.replaced += 1
                entry.numbers = [*other.numbers, *entry.numbers]
                entry.item = _with_news(entry.item, other.item)  # its news is still unread
        self._waiting.append(entry)

    def _renege(self) -> None:
        """Drop lines that have waited too long: they are missed."""
        there = [e for e in self._waiting if self._now_s - e.shown_s <= self.settings.patience_s]
        self.measures.missed += len(self._waiting) - len(there)
        self._waiting = there


def person_of(briefing: Briefing, *, is_ranked: bool = False) -> SimulatedOperator | None:
    operator = briefing.operator
    if not operator.person.is_on:
        return None
    rng = Random(f"deltaswarm/{briefing.seed}/person")
    return SimulatedOperator(operator.person, rng, operator.threshold_hz, first_delta(briefing), is_ranked)
