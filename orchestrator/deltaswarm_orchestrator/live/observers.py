"""Observers of a run in progress: viewers and terminals, which only read and do not affect the run."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol, Self

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.recording.sink import Sink
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.truth import Truth
from deltaswarm_wire.foreign import called
from deltaswarm_wire.operator_messages import Report, Status, Workload
from deltaswarm_wire.plugin_errors import PluginError, defined_at, is_interrupt

LOOK_EVERY_S = 0.1
"""Wall time between two looks [s]."""


@dataclass
class Seen:
    """What there is to see of a run; None for what has not arrived yet, or is not sent."""

    status: Status | None = None
    """The world's newest status."""
    newest_truth: Truth | None = None
    """The true state of the newest step; always None in a run that is neither recorded nor shown."""
    newest_workload: Workload | None = None
    """The operator's newest workload."""
    messages: int | None = None
    """Reports that the operator has counted since this process began to watch; None if not all were seen."""


class LiveObserver(Protocol):
    """Looks at a run. It is called often, takes what it wants at its own pace, and never blocks."""

    def look(self, seen: Seen) -> None:
        """Look at the run."""


class NamedObserver(LiveObserver, AbstractContextManager["NamedObserver"], Protocol):
    """What `--live` names: an observer of another package, which a run enters before its first step.

    Args:
        connect: where it is reached; empty for its default.
        scenario: the run's scenario.

    Raises:
        LiveError: the run cannot be shown there.
    """

    shows: str
    """What it shows, for the user."""

    def __init__(self, connect: str, scenario: Scenario) -> None: ...


class Guarded:
    """Drops an observer that raises, because observers must not change a run."""

    def __init__(self, observer: "NamedObserver", say: Callable[[str], None]) -> None:
        self._name = f"{type(observer).__module__}:{type(observer).__qualname__}"
        self._observer, self._say = observer, say
        self._failed = False

    def __enter__(self) -> Self:
        own: Any = self._observer
        enter = f"{self._name}.__enter__"
        self._observer = called(enter, lambda: own.__enter__(), at=type(own), passes=(CommandError,))
        if not hasattr(self._observer, "look"):
            must = f"{enter} must return an observer, with look (got {self._observer!r:.80})"
            raise PluginError(f"{must} ({defined_at(type(own))})")
        return self

    def __exit__(self, *error: Any) -> None:
        self._failed = False
        self._try(lambda: self._observer.__exit__(*error))

    def look(self, seen: Seen) -> None:
        self._try(lambda: self._observer.look(seen))

    def _try(self, call: Callable[[], object]) -> None:
        if self._failed:
            return
        try:
            call()
        except BaseException as error:
            if is_interrupt(error):
                raise
            self._failed = True
            text = f"live: observer {self._name} failed, and is shown no more"
            self._say(PluginError(text, error, type(self._observer)).report)


class Paced:
    """Says when it is time to look: ten times per second of wall time."""

    def __init__(self, wall: Callable[[], float] = time.monotonic) -> None:
        self._wall = wall
        self._due_s = wall()

    def is_due(self) -> bool:
        """Return whether it is time to look; if so, the next look is due after LOOK_EVERY_S."""
        now_s = self._wall()
        if now_s < self._due_s:
            return False
        self._due_s = now_s + LOOK_EVERY_S
        return True


class Tap(Seen):
    """The `Sink` of a run in one process that shows everything to observers and passes it on to another sink."""

    def __init__(self, sink: Sink, observers: Sequence[LiveObserver]) -> None:
        super().__init__(messages=0)
        self._observers = observers
        self._sink = sink
        self.log, self.radio, self.report_bytes, self.save = sink.log, sink.radio, sink.report_bytes, sink.save

    def step(self, truth: Truth, reports: Sequence[Report]) -> None:
        self.newest_truth = truth
        self._sink.step(truth, reports)

    def workload(self, workload: Workload) -> None:
        """Take the operator's workload of the step, and let the observers look."""
        self.newest_workload = workload
        self.messages = (self.messages or 0) + workload.messages
        self._sink.workload(workload)
        for observer in self._observers:
            observer.look(self)
