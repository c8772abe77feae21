"""Where the agents of one run are: which hosts have which, and at which address they reach the world."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from deltaswarm_orchestrator.remote.credentials import Credentials
from deltaswarm_orchestrator.remote.host_job import HostJob, News
from deltaswarm_orchestrator.remote.plan import ClusterError, Remote, Worker, divide, spans
from deltaswarm_wire.endpoints import host_and_port


class Host(Protocol):
    """One worker, which hosts agents."""

    worker: Worker

    def start(self, job: HostJob) -> None:
        """Begin to start the agents of a job."""

    def is_started(self) -> bool:
        """Whether the host has the job.

        Raises:
            HostLostError: the host did not take it.
        """

    def news(self) -> News | None:
        """Return what has happened, or None if nothing new has arrived.

        Raises:
            HostLostError: the host is lost.
        """

    def stop(self) -> None:
        """Ask the host to end its agents.

        Raises:
            HostLostError: the host is lost.
        """

    def close(self) -> None:
        """Let go of the host, which then ends what it still runs and removes the agents' files."""


class Cluster(Protocol):
    """The machines on which agents can run."""

    @property
    def problem(self) -> str:
        """Why the whole cluster is lost, or "" while it is not."""


@dataclass(frozen=True)
class Placement:
    """The hosts of a run's agents."""

    cluster: Cluster
    blocks: Mapping[Host, Sequence[int]]
    """The agents of each host."""
    listen: str
    """Where the world listens for them."""
    credentials: Credentials

    @property
    def workers(self) -> dict[str, list[int]]:
        """The agents of each worker, as the manifest lists them."""
        return {str(host.worker): [*block] for host, block in self.blocks.items()}


@contextmanager
def placed(remote: Remote | None, agents: int, say: Callable[[str], object]) -> Iterator[Placement | None]:
    """Yield the places of a run's agents on the workers of a scheduler, all checked; None if they run here.

    `say` tells the user where they are.

    Raises:
        ClusterError: the cluster cannot do this run; nothing has been started.
    """
    if remote is None:
        yield None
        return
    from deltaswarm_orchestrator.remote.dask_cluster import connected  # no other run needs Dask

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
        hosts: dict[Host, Sequence[int]] = {
            host: blocks[host.worker] for host in cluster.hosts() if host.worker in blocks
        }
        yield Placement(cluster, hosts, listen, credentials)
