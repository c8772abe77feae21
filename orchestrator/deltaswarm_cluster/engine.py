"""`--engine dask`: the agents of a run, or the runs of a sweep, on the workers of a Dask scheduler."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from deltaswarm_cluster.plan import ClusterError, divide, listen_problem, spans
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.paths import check_ports
from deltaswarm_orchestrator.processes.boards import signal_problems
from deltaswarm_orchestrator.processes.certificates import check_host
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.extras import missing
from deltaswarm_wire.session import host_and_port

if TYPE_CHECKING:
    from deltaswarm_cluster.agents import DaskPlacement
    from deltaswarm_orchestrator.sweeps.engine import Engine


class Dask:
    """The `RunEngine` of the workers of a Dask scheduler; without an address, for sweeps, of a local cluster."""

    def __init__(self, scheduler: str | None, listen: str = "") -> None:
        if needs := missing("distributed"):
            raise CommandError(f"engine dask {needs}")
        self._scheduler, self._listen = scheduler, listen

    def check(self, scenario: Scenario) -> None:
        """Check that the agents of a scenario can run there."""
        if not self._scheduler:
            raise CommandError("--engine dask must be given with --scheduler for a run: its agents are on the workers")
        problems = []
        if self._listen and (problem := listen_problem(self._listen)):
            problems.append(Problem("--listen", repr(self._listen), problem))
        problems += signal_problems(scenario, "which are on other machines")
        if problems:
            raise SettingsError(problems)
        if self._listen:
            check_ports({"--listen": self._listen})

    @contextmanager
    def placed(self, agents: int, say: Callable[[str], object]) -> "Iterator[DaskPlacement]":
        """Yield the places of a run's agents on the workers, all checked; `say` tells the user where they are."""
        from deltaswarm_cluster.agents import DaskPlacement
        from deltaswarm_cluster.dask_cluster import connected  # no other run needs Dask

        assert self._scheduler
        with connected(self._scheduler) as cluster:
            listen = cluster.endpoint(self._listen)
            try:
                check_host(host_and_port(listen)[0])
            except ValueError as error:
                raise ClusterError(str(error).replace("--host", "--listen")) from None
            blocks = divide(range(agents), cluster.workers)
            for worker, block in blocks.items():
                say(f"{spans(block)} on Dask worker {worker}")
            if not cluster.is_private:
                unencrypted = f"warning: the agents' keys go to {self._scheduler} unencrypted"
                say(f"{unencrypted}; a scheduler at tls:// encrypts them")
            hosts = {cluster.host(worker): block for worker, block in blocks.items()}
            yield DaskPlacement(cluster, hosts, listen)

    def sweep_engine(self, workers: int) -> "Engine":
        from deltaswarm_cluster.sweep_engine import DaskEngine

        return DaskEngine(self._scheduler, workers)
