"""Thin a run's messages for live viewers: at most ten times per second of wall time, the newest of each topic.

A run makes hundreds of steps per second, more than anybody can see. Log lines and changes of events are all
shown, because none of them replaces another.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence

from deltaswarm_orchestrator.recording.transcriber import TopicMessage, Transcriber, log_message, workload_message
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import Truth
from deltaswarm_wire.operator_messages import Report, Workload

SHOW_EVERY_S = 0.1
"""Wall time between updates [s]."""

NEVER_DROPPED = ("/log", "/swarm/event")

MAX_WAITING = 1000
"""Most waiting messages of topics that are never dropped for the rate; the oldest are dropped first."""

Send = Callable[[str, float, bytes], None]
"""Takes a topic, a simulated time [s] and a message; must not block."""


class RateLimited:
    """A `Viewer` that sends messages at most every `SHOW_EVERY_S` by the clock `wall` [s]."""

    def __init__(self, send: Send, wall: Callable[[], float] = time.monotonic) -> None:
        self.time_s = 0.0
        """The newest simulated time of any message [s]."""
        self._send = send
        self._wall = wall
        self._due_s = wall()
        self._newest: dict[str, tuple[float, bytes]] = {}
        self._fresh: dict[str, None] = {}
        """The topics that have a new message, in the order in which they got it."""
        self._waiting: deque[tuple[str, float, bytes]] = deque(maxlen=MAX_WAITING)
        self._later: tuple[float, Callable[[], Iterable[TopicMessage]]] | None = None
        self._shows_all = False

    def put(self, topic: str, time_s: float, data: bytes) -> None:
        self.time_s = max(self.time_s, time_s)
        if topic in NEVER_DROPPED:
            self._waiting.append((topic, time_s, data))
        else:
            self._newest[topic] = time_s, data
            self._fresh[topic] = None

    def later(self, time_s: float, make: Callable[[], Iterable[TopicMessage]]) -> None:
        """Make messages of a simulated time [s] when they are due, unless a newer call comes first."""
        self._later = time_s, make

    def show_all(self) -> None:
        """Send the newest message of every topic at the next tick, for a new viewer. Any thread may call this."""
        self._shows_all = True

    def flush(self) -> None:
        """Send what waits, since no tick will follow."""
        self._due_s = -math.inf
        self.tick()

    def tick(self) -> None:
        now_s = self._wall()
        if now_s < self._due_s:
            return
        if self._later is not None:
            (time_s, make), self._later = self._later, None
            for topic, data in make():
                self.put(topic, time_s, data)
        if self._shows_all:
            self._shows_all = False
            self._fresh = dict.fromkeys(self._newest)
        if not self._fresh and not self._waiting:
            return  # still due: the next message is shown at once
        self._due_s = now_s + SHOW_EVERY_S
        for topic in self._fresh:
            self._send(topic, *self._newest[topic])
        self._fresh.clear()
        while self._waiting:
            self._send(*self._waiting.popleft())


class ViewersOnly:
    """The `Sink` of a run that is shown but not recorded; views are made only when they are due."""

    def __init__(self, scenario: Scenario, viewer: RateLimited, wall: Callable[[], float] = time.monotonic) -> None:
        self._wall = wall
        self._started_s = wall()
        self._transcriber = Transcriber(scenario)
        self._viewer = viewer

    def step(self, truth: Truth, reports: Sequence[Report]) -> None:
        for topic, data in self._transcriber.events(truth.events):
            self._viewer.put(topic, truth.time_s, data)
        self._viewer.later(truth.time_s, lambda: self._messages(truth, reports))
        self._viewer.tick()

    def _messages(self, truth: Truth, reports: Sequence[Report]) -> Iterable[TopicMessage]:
        yield from self._transcriber.figures(truth, reports, round(self._wall() - self._started_s, 3))
        yield from self._transcriber.views(truth)

    def workload(self, workload: Workload) -> None:
        self._viewer.put("/operator/workload", workload.time_s, workload_message(workload))
        self._viewer.tick()

    def log(self, level: int, name: str, text: str, time_s: float) -> None:
        self._viewer.put("/log", time_s, log_message(level, name, text, time_s))

    def radio(self, step: int, agent: int, data: bytes) -> None:
        """Discard a raw frame or report, which are for recordings."""

    report_bytes = radio

    def save(self) -> None:
        """Do nothing, since nothing is kept."""
