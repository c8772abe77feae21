"""Who looks on at a run under way: viewers and terminals, which take what they see and leave no trace in it."""

import time
from collections.abc import Callable, Sequence
from typing import Protocol

from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_wire.operator_messages import Report, Status, Workload
from deltaswarm_wire.truth import Truth

LOOK_EVERY_S = 0.1
"""Wall time."""


class Seen(Protocol):
    """What there is to see of a run; None is what has not been heard yet, or is not told."""

    @property
    def status(self) -> Status | None:
        """How the world is."""

    @property
    def newest_truth(self) -> Truth | None:
        """Where everything is; None throughout a run that is neither recorded nor shown."""

    @property
    def newest_workload(self) -> Workload | None:
        """What the operator counted last."""

    @property
    def messages(self) -> int | None:
        """Reports that the operator has counted since this process watches; None where not all are told."""


class Onlooker(Protocol):
    """Called often. Takes what it wants at its own pace, and never waits."""

    def look(self, seen: Seen) -> None:
        """Look at the run."""


class Paced:
    """Says ten times per second of wall time that it is time to look."""

    def __init__(self, wall: Callable[[], float] = time.monotonic) -> None:
        self._wall = wall
        self._due_s = wall()

    def is_due(self) -> bool:
        """Whether enough time has passed since it last said so."""
        now_s = self._wall()
        if now_s < self._due_s:
            return False
        self._due_s = now_s + LOOK_EVERY_S
        return True


class Tap:
    """The `Sink` of a run in one process that shows onlookers what passes, and hands it on."""

    def __init__(self, sink: Sink, onlookers: Sequence[Onlooker]) -> None:
        self.status: Status | None = None
        self.newest_truth: Truth | None = None
        self.newest_workload: Workload | None = None
        self.messages: int | None = 0
        self._onlookers = onlookers
        self._reported = 0
        self._sink = sink
        self.log, self.radio, self.report_bytes, self.save = sink.log, sink.radio, sink.report_bytes, sink.save

    def step(self, truth: Truth, reports: Sequence[Report]) -> None:
        """One closed step."""
        self.newest_truth = truth
        self._sink.step(truth, reports)

    def workload(self, workload: Workload) -> None:
        """What the operator counted in it."""
        self.newest_workload = workload
        self.messages = (self.messages or 0) + workload.messages
        self._sink.workload(workload)
        for onlooker in self._onlookers:
            onlooker.look(self)
