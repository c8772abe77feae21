"""`--engine dask`: the agents of a run, or the runs of a sweep, on the workers of a Dask scheduler."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING

from deltaswarm_cluster.agents import Credentials, DaskPlacement, Supervisor
from deltaswarm_cluster.plan import ClusterError, Remote, divide, spans
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.paths import check_ports
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.extras import missing
from deltaswarm_wire.session import host_and_port

if TYPE_CHECKING:
    from deltaswarm_orchestrator.sweeps.engine import Engine


class Dask:
    """The `RunEngine` of the workers of a Dask scheduler; without an address, for sweeps, of a local cluster."""

    def __init__(self, scheduler: str | None, listen: str = "") -> None:
        if needs := missing("distributed"):
            raise CommandError(f"engine dask {needs}")
        self._scheduler, self._remote = scheduler, Remote(scheduler or "", listen)

    def check(self, scenario: Scenario) -> None:
        """Check that the agents of a scenario can run there.

        Raises:
            SettingsError: they cannot.
            CommandError: there is no scheduler, or the address at which the world would listen is taken.
        """
        if not self._scheduler:
            raise CommandError("--engine dask must be given with --scheduler for a run: its agents are on the workers")
        self._remote.check(scenario)
        if self._remote.listen:
            check_ports({"--listen": self._remote.listen})

    def placed(self, agents: int, say: Callable[[str], object]) -> AbstractContextManager[DaskPlacement]:
        """Yield the places of a run's agents, as `_placed`."""
        return _placed(self._remote, agents, say)

    def sweep_engine(self, workers: int) -> "Engine":
        """Return an engine for the runs of a sweep."""
        from deltaswarm_cluster.sweep_engine import DaskEngine

        return DaskEngine(self._scheduler, workers)


@contextmanager
def _placed(remote: Remote, agents: int, say: Callable[[str], object]) -> Iterator[DaskPlacement]:
    """Yield the places of a run's agents on the workers of a scheduler, all checked.

    `say` tells the user where they are.

    Raises:
        ClusterError: the cluster cannot do this run; nothing has been started.
    """
    from deltaswarm_cluster.dask_cluster import connected  # no other run needs Dask

    with connected(remote) as cluster:
        listen = cluster.endpoint(remote.listen)
        try:
            credentials = Credentials.create(host_and_port(listen)[0])
        except ValueError as error:
            raise ClusterError(str(error).replace("--host", "--listen")) from None
        blocks = divide(range(agents), cluster.workers)
        for worker, block in blocks.items():
            say(f"{spans(block)} on Dask worker {worker}")
        if not cluster.is_private:
            say(f"warning: the agents' keys go to {remote.scheduler} unencrypted; a scheduler at tls:// encrypts them")
        supervisors: dict[Supervisor, Sequence[int]] = {
            supervisor: blocks[supervisor.worker] for supervisor in cluster.supervisors() if supervisor.worker in blocks
        }
        yield DaskPlacement(cluster, supervisors, listen, credentials)
