"""Interfaces of objects that record or show a run."""

from collections.abc import Sequence
from typing import Protocol

from deltaswarm_scenario.truth import Truth
from deltaswarm_wire.operator_messages import Report, Workload


class Sink(Protocol):
    """Takes a run's data: the recorder, a live view, or a test's stand-in."""

    def step(self, truth: Truth, reports: Sequence[Report]) -> None: ...

    def workload(self, workload: Workload) -> None: ...

    def radio(self, step: int, agent: int, data: bytes) -> None: ...

    def save(self) -> None:
        """Write everything so far to disk, so that it survives a crash of the machine."""

    def log(self, level: int, name: str, text: str, time_s: float) -> None: ...

    def report_bytes(self, step: int, agent: int, data: bytes) -> None: ...


class Viewer(Protocol):
    """Shows a run's messages while it is under way. May thin them, and never makes the run wait."""

    def put(self, topic: str, time_s: float, data: bytes) -> None:
        """Take one message, at a simulated time [s]."""

    def tick(self) -> None:
        """Send what is due. Called after each step, and now and then while no step is made."""
