"""Learning while it runs: a bandit over a few structures, whose estimates agents share (`delta_rule = "bandit"`).

An agent chooses whenever it begins to walk, and keeps the structure until it walks again; a member of a tree has its
parent's. So what comes of a structure is counted for it: the time of agents, their work on events, and messages to the
operator. It costs, per second of work, `(busy * time + price * messages) / work`. With `busy`, the share of their time
in which agents work (`finds.py`), a structure under which they work as much as on average costs a second, and messages.

Old counts fade, and an agent mixes in those that it hears. A structure that was hardly tried is as good as the mean.
"""

import math
from random import Random

from deltaswarm_agent.controllers.paper.finds import WEIGHT_PER_S
from deltaswarm_agent.controllers.paper.frames import Tried
from deltaswarm_agent.controllers.paper.policy import Structure

ARMS = (
    Structure(3, True),
    Structure(2, True),
    Structure(4, True),
    Structure(6, True),
    Structure(None, True),
    Structure(2, False),
)
"""The structures: hybrid control with these deltas, decentralised, and hierarchical control."""

EXPLORES = 0.15
"""The probability with which an agent tries any of them; else it takes the best, of equal ones the first."""

FADING_S = 600.0
"""Counts this old count a factor e less."""

MEAN_S = 60.0
"""Work at the mean cost that counts for every structure beside its own."""


class Bandit:
    """What one agent knows of the structures. Like `Finds`, it is brought up to date only when something changes."""

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s
        self._kept: float = (1.0 - WEIGHT_PER_S) ** step_s
        self._since: int | None = None
        """None before the first step: an agent may begin late."""
        self._works = False
        self.counts = True
        """Not while an order says which structure the agent has: what comes of that is no outcome of its choice."""
        self.arm = 0
        """The structure that it follows."""
        self.time_s, self.work_s, self.messages = ([0.0] * len(ARMS) for _ in range(3))

    def update(self, now: int) -> None:
        """Let the time since the last update pass."""
        passed_s = 0.0 if self._since is None else (now - self._since) * self._step_s
        self._since = now
        if passed_s <= 0.0:
            return
        kept = math.exp(-passed_s / FADING_S)
        for arm in range(len(ARMS)):
            self.time_s[arm] *= kept
            self.work_s[arm] *= kept
            self.messages[arm] *= kept
        if not self.counts:
            return
        self.time_s[self.arm] += FADING_S * (1.0 - kept)
        if self._works:
            self.work_s[self.arm] += FADING_S * (1.0 - kept)

    def begin(self, works: bool, now: int) -> None:
        """Say whether the agent works from this step on."""
        if works != self._works or self._since is None:
            self.update(now)
            self._works = works

    def report(self, now: int) -> None:
        self.update(now)
        if self.counts:
            self.messages[self.arm] += 1.0

    def count(self, counts: bool, now: int) -> None:
        """Say whether it counts from this step on."""
        if counts != self.counts:
            self.update(now)
            self.counts = counts

    def follow(self, arm: int, now: int) -> None:
        """Count what comes from this step on for another structure."""
        self.update(now)
        self.arm = arm

    def best(self, busy: float, price_s: float) -> int:
        """Return the structure with the lowest cost."""
        costs = [busy * self.time_s[arm] + price_s * self.messages[arm] for arm in range(len(ARMS))]
        total, work_s, best, least = 0.0, 0.0, 0, math.inf
        for arm in range(len(ARMS)):
            total += costs[arm]
            work_s += self.work_s[arm]
        mean = total / (work_s + MEAN_S)
        for arm in range(len(ARMS)):
            cost = (costs[arm] + MEAN_S * mean) / (self.work_s[arm] + MEAN_S)
            if cost < least:
                best, least = arm, cost
        return best

    def choose(self, busy: float, price_s: float, rng: Random, now: int) -> Structure:
        """Choose a structure, and follow it."""
        self.update(now)
        self.arm = rng.choice(range(len(ARMS))) if rng.random() < EXPLORES else self.best(busy, price_s)
        return ARMS[self.arm]

    def hear(self, heard: list[Tried], now: int) -> None:
        """Mix in what others know of the structures that they follow, in whichever order it came."""
        self.update(now)
        for arm in {tried.arm for tried in heard}:
            told = [tried for tried in heard if tried.arm == arm]
            kept = self._kept ** len(told)
            share = (1.0 - kept) / len(told)
            self.time_s[arm] = kept * self.time_s[arm] + share * sum([one.time_ds for one in told]) / 10
            self.work_s[arm] = kept * self.work_s[arm] + share * sum([one.work_ds for one in told]) / 10
            self.messages[arm] = kept * self.messages[arm] + share * sum([one.messages_milli for one in told]) / 1000

    def told(self, now: int) -> Tried | None:
        """Return what it tells of its structure, if it follows one."""
        self.update(now)
        if not self.counts:
            return None
        arm = self.arm
        counts = round(10 * self.time_s[arm]), round(10 * self.work_s[arm]), round(1000 * self.messages[arm])
        return Tried(arm, *counts)
