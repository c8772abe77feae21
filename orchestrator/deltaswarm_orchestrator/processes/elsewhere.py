"""Agents that run on other machines: what a run asks of them, and of the engine that `--engine` names."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from deltaswarm_orchestrator.processes.process import RunPart
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.session import Tls

WORKER, SCHEDULER = "worker", "scheduler"
"""Roles of the parts that stand for machines and for what leads to them."""


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


class Placement(Protocol):
    """The places of a run's agents, checked before the run begins."""

    @property
    def workers(self) -> Mapping[str, Sequence[int]]:
        """The agents of each machine, as the manifest lists them."""

    def check_controller(self, mode: str) -> None:
        """Check that all machines have the files of the controller as this one has them now.

        Raises:
            CommandError: some have others.
        """

    def agents(self, scenario: Scenario, logs: Path) -> AgentsElsewhere:
        """Return the agents at their places, not started yet; their logs come into the folder `logs`."""


class RunEngine(Protocol):
    """What `--engine` names: the machines on which agents, or whole runs of a sweep, are started.

    Args:
        scheduler: the address of what leads to the machines; None if none was given.
        listen: the endpoint at which the machines reach the world; empty for this machine's address.

    Raises:
        CommandError: something that the engine needs is not installed here.
    """

    def __init__(self, scheduler: str | None, listen: str = "") -> None: ...

    def check(self, scenario: Scenario) -> None:
        """Check that the agents of a scenario can run there.

        Raises:
            SettingsError: they cannot.
        """

    def placed(self, agents: int, say: Callable[[str], object]) -> AbstractContextManager[Placement]:
        """Reserve places for that many agents; `say` tells the user where they are.

        Raises:
            CommandError: the machines cannot do this run; nothing has been started.
        """

    def sweep_engine(self, workers: int) -> Any:
        """Return the `sweeps.engine.Engine` for the runs of a sweep, with this many workers if it starts them."""
