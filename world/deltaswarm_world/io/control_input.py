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


class Persisted(NamedTuple):
    """Newest step on disk at operator or recorder (-1: none yet)."""

    role: str
    step: int


class Ack(NamedTuple):
    """The operator's encoded workload."""

    data: bytes


class OperatorMessage(NamedTuple):
    """What the operator says of the steps: its turn, or the pace that it wants."""

    word: Turn | Pace


ControlInput = Token | Persisted | Ack | OperatorMessage


class ControlQueue:
    """From Zenoh's threads to the main one.

    Of an agent's comings and goings it keeps the newest two: an agent may tell of them as often as it likes.
    """

    def __init__(self) -> None:
        self._queue: deque[ControlInput | int] = deque()
        """An agent's number stands for its `_comings`."""
        self._comings: dict[int, list[bool]] = {}
        self._lock = threading.Lock()

    def put(self, message: ControlInput) -> None:
        """Add to the queue. Never blocks for long."""
        if not isinstance(message, Token) or message.role != AGENT:
            self._queue.append(message)
            return
        with self._lock:
            if message.number not in self._comings:
                self._queue.append(message.number)
            self._comings[message.number] = [*self._comings.get(message.number, [])[-1:], message.is_there]

    def drain(self) -> Iterator[ControlInput]:
        """What has come so far; what comes meanwhile is for the next time."""
        for _ in range(len(self._queue)):
            message = self._queue.popleft()
            if isinstance(message, int):
                with self._lock:
                    comings = self._comings.pop(message)
                yield from (Token(AGENT, message, is_there) for is_there in comings)
            else:
                yield message
