"""What the processes of a run must know of agents that run on other machines."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from deltaswarm_orchestrator.processes.process import RunPart
from deltaswarm_wire.session import Tls


class AgentsElsewhere(Protocol):
    """All agents of a run, on other machines."""

    @property
    def listen(self) -> str:
        """The endpoint at which the world listens for them."""

    @property
    def parts(self) -> Sequence[RunPart]:
        """The agents, and their machines, as of the last look."""

    @property
    def agents(self) -> Sequence[RunPart]:
        """The agents, as of the last look."""

    def write_worlds(self, folder: Path) -> Tls:
        """Write the world's certificate into a private folder, from which it can go once the router has read it."""

    def start(self, run: str, endpoint: str, zenoh: Sequence[str], was_stopped: Callable[[], object]) -> None:
        """Start all agents at the world's endpoint.

        Raises:
            LaunchError: some could not be started.
            StoppedError: the user asked to stop.
        """

    def look(self) -> None:
        """Take note of what has happened to them."""

    def end(self, *, at_once: bool) -> None:
        """End all that still run, and collect their logs unless this must be at once."""
