"""Where runs are done: on this machine, or by the engine of an installed package on others, which is checked here."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.checked import SettingsError
from deltaswarm_wire.foreign import Foreign, name_of
from deltaswarm_wire.plugin_errors import PluginError, defined_at
from deltaswarm_wire.plugins import ENGINES, find

if TYPE_CHECKING:  # the command line imports this file
    from deltaswarm_orchestrator.processes.process import RunPart
    from deltaswarm_scenario.scenario import Scenario
    from deltaswarm_wire.session import Tls

LOCAL = "local"
"""This machine."""

PYTHON, DENSE = "python", "dense"
IN_ONE_PROCESS = (PYTHON, DENSE)
"""Engines of this machine that do runs in one process, on which `--engine` can insist."""

WORKER, SCHEDULER = "worker", "scheduler"
"""Roles of the parts that stand for machines and for what leads to them."""


class AgentsElsewhere(Protocol):
    """All agents of a run, on other machines."""

    @property
    def listen(self) -> str:
        """The endpoint at which the world listens for them."""

    @property
    def parts(self) -> "Sequence[RunPart]":
        """The agents, and their machines, as of the last look."""

    @property
    def agents(self) -> "Sequence[RunPart]":
        """The agents, as of the last look."""

    def write_worlds(self, folder: Path) -> "Tls":
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

    def agents(self, scenario: "Scenario", logs: Path) -> AgentsElsewhere:
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

    def check(self, scenario: "Scenario") -> None:
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


def _with(value: Any, *members: str) -> Any:
    if missing := [member for member in members if not hasattr(value, member)]:
        raise ValueError(f"must return an object with {', '.join(missing)} (got {value!r:.80})")
    return value


class ForeignPlacement(Foreign):
    PASSES = (CommandError,)
    CHECKS: ClassVar = {
        "workers": lambda _, value: _with(value, "items"),
        "agents": lambda _, value, *arguments: _with(
            value, *("listen", "parts", "agents", "write_worlds", "start", "look", "end")
        ),
    }


@contextmanager
def _placed(kind: type[Any], value: Any, *arguments: Any) -> Iterator[ForeignPlacement]:
    with value as placement:
        if not (hasattr(placement, "workers") and hasattr(placement, "agents")):
            must = f"{name_of(kind)}.placed must yield a Placement, with workers and agents (got {placement!r:.80})"
            raise PluginError(f"{must} ({defined_at(kind)})")
        yield ForeignPlacement(placement)


def _runs(kind: type[Any], value: Any, tasks: Any) -> Iterator[Any]:
    try:
        for done in value:
            if not (hasattr(done, "task") and hasattr(done, "result")):
                raise PluginError(f"{name_of(kind)}: run must yield Done (got {done!r:.80}) ({defined_at(kind)})")
            yield done
    finally:
        getattr(value, "close", lambda: None)()  # abandons the other runs


class ForeignSweepEngine(Foreign):
    PASSES = (CommandError,)
    CHECKS: ClassVar = {"run": _runs}


class ForeignEngine(Foreign):
    """An engine from outside; its context is its class."""

    PASSES = (CommandError, SettingsError)
    CHECKS: ClassVar = {
        "placed": lambda kind, value, *arguments: _placed(kind, _with(value, "__enter__", "__exit__")),
        "sweep_engine": lambda kind, value, workers: ForeignSweepEngine(_with(value, "run"), kind),
    }


def engine_of(
    name: str,
    scheduler: str | None,
    listen: str = "",
    *,
    path: str = "--engine",
    local: Collection[str] = (LOCAL, *IN_ONE_PROCESS),
) -> RunEngine | None:
    """Return the engine of this name; None for this machine, which the names in `local` mean.

    `path` says where the name was given, for messages.

    Raises:
        SettingsError: there is no such engine.
        CommandError: something that it needs is not installed, or this machine has no use for a scheduler.
    """
    if name in local:
        if scheduler:
            raise CommandError("--scheduler is for --engine dask")
        return None
    kind = find(ENGINES, name, path, others=local)
    engine: RunEngine = ForeignEngine.make(kind, scheduler, listen, context=kind)
    return engine
