"""Averages of how often walkers find events and how busy agents are, for `patience`, `returning` and `delta`.

Each agent keeps its own averages, in which old finds count less and less, and mixes in those that it hears. So
agents that meet soon agree, and an agent that stands in a tree for a long time still learns what walkers find.
"""

import math

from deltaswarm_agent.controllers.paper.frames import Attending, Averages, Member, PaperFrame
from deltaswarm_wire.codec import MAX_ID
from deltaswarm_wire.settings import AgentSettings

FADING_S = 1000.0
"""Finds and seconds this old count a factor e less."""

FIRST_FINDS, FIRST_S = 0.5, 150.0
"""What each average begins with, on legs of each kind."""

LEAST_FINDS = 0.001
"""Averages of finds do not fall below this: it is what a frame can tell."""

LEAST_S = 1e-9
"""Nor do averages of times: others may claim none at all, and rates divide by them."""

WEIGHT_PER_S = 0.02
"""The share of another agent's averages in one's own after a second in which it is heard."""

RANDOM, RETURNING = 0, 1
"""The kinds of legs of a walk (`walk.py`, `returning.py`)."""


class Finds:
    """Averages of one agent.

    They are brought up to date when the agent's activity changes or it hears or senses something, and not in between,
    so that an agent that is not asked in every step has the same ones.
    """

    def __init__(self, shared: AgentSettings) -> None:
        self._step_s = shared.step_s
        self._kept: float = (1.0 - WEIGHT_PER_S) ** shared.step_s
        """The weight of its own averages beside one agent's that it hears in a step."""
        self._since = 0
        self._leg: int | None = None
        """The kind of leg on which the agent has been since then; None: it was not walking."""
        self._works = False
        self._finds = [FIRST_FINDS, FIRST_FINDS]
        self._walked_s = [FIRST_S, FIRST_S]
        self.busy = 0.0
        """The share of the time in which agents work on events (0 to 1)."""

    @property
    def rate_hz(self) -> float:
        """New events that a walker finds per second (w)."""
        return sum(self._finds, 0.0) / sum(self._walked_s, 0.0)

    @property
    def ratio(self) -> float:
        """Finds per second on random legs by those on returning ones (r0 / r1)."""
        random, returning = self._finds
        return random * self._walked_s[RETURNING] / (returning * self._walked_s[RANDOM])

    def update(self, now: int) -> None:
        """Let the time since the last update pass."""
        passed_s = (now - self._since) * self._step_s
        if passed_s <= 0.0:
            return
        self._since = now
        kept = math.exp(-passed_s / FADING_S)
        self.busy = kept * self.busy + (1.0 - kept) * self._works
        if self._leg is not None:
            self._finds = [max(LEAST_FINDS, finds * kept) for finds in self._finds]
            self._walked_s = [walked_s * kept for walked_s in self._walked_s]
            self._walked_s[self._leg] += FADING_S * (1.0 - kept)

    def begin(self, leg: int | None, works: bool, now: int) -> None:
        if leg != self._leg or works != self._works:
            self.update(now)
            self._leg, self._works = leg, works

    def find(self, count: int) -> None:
        """Count events that this agent found in this step, if it was walking. Call `update` first."""
        if self._leg is not None:
            self._finds[self._leg] += count

    def hear(self, heard: list[PaperFrame], now: int) -> None:
        """Mix in the averages of others, in whichever order they came."""
        told = [frame.averages for frame in heard if type(frame) is Attending or type(frame) is Member]
        averages = [one[:-1] for one in told if one is not None]
        if not averages:
            return
        self.update(now)
        kept = self._kept ** len(averages)
        means = [(1.0 - kept) * sum(column, 0.0) / len(averages) for column in zip(*averages, strict=True)]
        self._finds = [
            max(LEAST_FINDS, kept * mine + mean / 1000) for mine, mean in zip(self._finds, means[:2], strict=True)
        ]
        self._walked_s = [
            max(LEAST_S, kept * mine + mean / 10) for mine, mean in zip(self._walked_s, means[2:4], strict=True)
        ]
        self.busy = kept * self.busy + means[4] / 1000

    def told(self, now: int) -> Averages:
        self.update(now)
        finds = [min(MAX_ID, round(1000 * finds)) for finds in self._finds]
        walked_ds = [round(10 * walked_s) for walked_s in self._walked_s]
        return Averages._make((*finds, *walked_ds, round(1000 * self.busy), None))
