"""What keeps or shows a run's record, as seen by those who feed it."""

from collections.abc import Sequence
from typing import Protocol

from deltaswarm_wire.operator_messages import Report, Workload
from deltaswarm_wire.truth import Truth


class Sink(Protocol):
    """The recorder, or a test's stand-in."""

    def step(self, truth: Truth, reports: Sequence[Report]) -> None:
        """One closed step."""

    def workload(self, workload: Workload) -> None:
        """What the operator counted."""

    def radio(self, step: int, agent: int, data: bytes) -> None:
        """One raw radio frame."""

    def save(self) -> None:
        """Have all that was said so far on disk, whatever becomes of the machine."""

    def log(self, level: int, name: str, text: str, time_s: float) -> None:
        """Something worth a line, at a simulated time [s]."""

    def report_bytes(self, step: int, agent: int, data: bytes) -> None:
        """One raw report."""


class Viewer(Protocol):
    """Who is shown a run's messages while it is under way; may thin them, and never makes the run wait."""

    def put(self, topic: str, time_s: float, data: bytes) -> None:
        """One message, at a simulated time [s]."""

    def tick(self) -> None:
        """Called after each step, and now and then while none is made: the moment to send what is due."""
