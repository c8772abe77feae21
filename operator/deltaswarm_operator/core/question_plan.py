"""Which question of each technique is planned when, which one has to wait, and which are not asked and why. Pure."""

import math
from collections.abc import Iterable
from random import Random
from typing import NamedTuple

from deltaswarm_scenario.technique import Technique

ANOTHER, AWAY, NOBODY, ENDED = "another question was open", "the page was away", "no station", "the run ended"


ROUNDING_S = 1e-9
"""The time of a step may be this much less than it should be."""


class Planned(NamedTuple):
    """A question of a technique, and once it has to wait, why, and when the one after it is planned."""

    number: int
    at_s: float
    why: str = ""
    next_s: float = math.inf


class QuestionPlan:
    """The questions during one run. A question that waits is asked late, until half the time to the next has passed."""

    def __init__(self, techniques: Iterable[Technique], rng: Random) -> None:
        self.next: dict[str, Planned] = {}
        """The next question of each technique."""
        self.dropped: list[tuple[Technique, Planned]] = []
        """Questions that are not asked, until somebody takes them."""
        self._rng = rng
        self._techniques = {technique.name: technique for technique in techniques}
        for name, technique in self._techniques.items():
            self.next[name] = Planned(0, technique.due_s(0, 0.0, rng))

    @property
    def techniques(self) -> Iterable[Technique]:
        return self._techniques.values()

    def first_s(self, *, holds_run: bool = False) -> float:
        """Return when the next question is planned, of all or of those that hold the run; inf: none is."""
        times_s = [
            planned.at_s
            for name, planned in self.next.items()
            if not holds_run or self._techniques[name].wait_s is None
        ]
        return min(times_s, default=math.inf)

    def due(self, name: str, now_s: float) -> Planned | None:
        """Return the question of a technique that is due, if one is; those that have waited too long are dropped."""
        planned = self.next[name]
        while planned.why and now_s >= min((planned.at_s + planned.next_s) / 2, planned.next_s):
            self._drop(name)
            if now_s >= self.next[name].at_s:
                self.wait(name, planned.why)
            planned = self.next[name]
        return planned if now_s >= planned.at_s - ROUNDING_S else None

    def wait(self, name: str, why: str) -> None:
        """Note why a question that is due cannot be asked now; those after it keep their times."""
        planned = self.next[name]
        if not planned.why:
            self.next[name] = planned._replace(why=why, next_s=self._after(name, planned.at_s))

    def ask(self, name: str, now_s: float) -> Planned:
        """Take a question that is asked now."""
        planned = self.next[name]
        next_s = planned.next_s if planned.why else self._after(name, max(planned.at_s, now_s))
        self.next[name] = Planned(planned.number + 1, next_s)
        return planned

    def end(self, now_s: float) -> None:
        """Drop what was planned before the end of the run and has not been asked."""
        for name in self.next:
            while self.next[name].at_s < now_s:
                self._drop(name)

    def _drop(self, name: str) -> None:
        self.wait(name, ENDED)
        planned = self.next[name]
        self.dropped.append((self._techniques[name], planned))
        self.next[name] = Planned(planned.number + 1, planned.next_s)

    def _after(self, name: str, last_s: float) -> float:
        return self._techniques[name].due_s(self.next[name].number + 1, last_s, self._rng)
