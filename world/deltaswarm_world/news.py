"""What the world is told by others than agents' samples, in order of arrival."""

import threading
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from deltaswarm_wire.commands import Pace, Turn
from deltaswarm_wire.keys import AGENT


class Token(NamedTuple):
    """A process appeared or disappeared."""

    role: str
    number: int
    is_there: bool


class Taken(NamedTuple):
    """Newest step on disk at operator or recorder (-1: none yet)."""

    role: str
    step: int


class Counted(NamedTuple):
    """The operator's encoded workload."""

    data: bytes


class Said(NamedTuple):
    """What the operator says of the steps: its turn, or the pace that it wants."""

    word: Turn | Pace


News = Token | Taken | Counted | Said


class NewsQueue:
    """From Zenoh's threads to the main one.

    Of an agent's comings and goings it keeps the newest two: an agent may tell of them as often as it likes.
    """

    def __init__(self) -> None:
        self._queue: deque[News | int] = deque()
        """An agent's number stands for its `_comings`."""
        self._comings: dict[int, list[bool]] = {}
        self._lock = threading.Lock()

    def put(self, news: News) -> None:
        """Add to the queue. Never blocks for long."""
        if not isinstance(news, Token) or news.role != AGENT:
            self._queue.append(news)
            return
        with self._lock:
            if news.number not in self._comings:
                self._queue.append(news.number)
            self._comings[news.number] = [*self._comings.get(news.number, [])[-1:], news.is_there]

    def take(self) -> Iterator[News]:
        """What has come so far; what comes meanwhile is for the next time."""
        for _ in range(len(self._queue)):
            news = self._queue.popleft()
            if isinstance(news, int):
                with self._lock:
                    comings = self._comings.pop(news)
                yield from (Token(AGENT, news, is_there) for is_there in comings)
            else:
                yield news
