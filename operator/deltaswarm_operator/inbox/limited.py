"""The policy `limited`: a limited number of lines per minute, most severe first; the rest waits or is summed up."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from deltaswarm_operator.inbox.item import Item
from deltaswarm_operator.inbox.policy import NEWEST, Put, alone, summed
from deltaswarm_scenario.operator_settings import ALERT, INFO, NOTICE
from deltaswarm_wire.checked import OURS, Problem, key

WAITS, SUMMED = "waits", "summed"
MINUTE_S = 60.0


@dataclass(frozen=True)
class LimitedSettings:
    per_min: int = key(6, "new lines in any 60 s, at most", source=OURS, low=1, high=10_000)
    reserve: int = key(3, "of these, lines that items of severity info leave free", source=OURS, low=0, high=10_000)
    rest: str = key(
        WAITS,
        "waits: what exceeds the limit waits for its turn; summed: the last line of a minute sums it up",
        choices=(WAITS, SUMMED),
    )

    def problems(self) -> list[Problem]:
        """Some item of severity info must have a line."""
        if self.reserve < self.per_min:
            return []
        return [Problem("reserve", f"{self.reserve}", f"must be below per_min, {self.per_min}")]


class Limited:
    """Shows at most `per_min` lines in any 60 s."""

    Settings = LimitedSettings
    ORDER = NEWEST
    HELD = "waits for its turn: the number of lines per minute is limited"

    def __init__(self, settings: LimitedSettings) -> None:
        self._settings = settings
        self._severe: dict[str, deque[Item]] = {ALERT: deque(), NOTICE: deque()}
        self._others: dict[str, deque[Item]] = {INFO: deque()}
        """Items that wait, by severity, the oldest first."""
        self._shown_s: deque[float] = deque()
        """Times of the lines of the last 60 s."""

    def close_step(self, now_s: float, items: Sequence[Item]) -> list[Put]:
        waiting = self._severe | self._others
        for item in items:
            waiting[item.severity].append(item)
        while self._shown_s and self._shown_s[0] <= now_s - MINUTE_S:
            self._shown_s.popleft()
        puts = self._puts(self._settings.per_min - len(self._shown_s))
        self._shown_s += [now_s] * len({put.line for put in puts})
        return puts

    def _puts(self, room: int) -> list[Put]:
        """Fill at most `room` lines; items of severity info leave `reserve` of them free."""
        if self._settings.rest == WAITS:
            severe = _take(self._severe, room)
            return alone([*severe, *_take(self._others, room - self._settings.reserve - len(severe))])
        excess = sum(map(len, self._severe.values())) > room
        puts = alone(_take(self._severe, room - excess))
        if excess and room:
            puts += summed(_take(self._severe))
        if room - self._settings.reserve > len(puts) and (others := _take(self._others)):
            puts += summed(others)
        return puts


def _take(waiting: Mapping[str, deque[Item]], most: float = math.inf) -> list[Item]:
    """Take items out, the most severe first."""
    taken: list[Item] = []
    for items in waiting.values():
        while items and len(taken) < most:
            taken.append(items.popleft())
    return taken
