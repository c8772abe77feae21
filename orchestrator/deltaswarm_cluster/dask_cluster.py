"""The workers of a Dask scheduler, and the hosts of agents there."""

import asyncio
import logging
import os
import socket
import sys
import time
import warnings
from asyncio import CancelledError
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from typing import Any
from urllib.parse import urlsplit

from distributed import Client
from distributed.versions import VersionMismatchWarning

from deltaswarm_cluster.host import HostActor, Job, News
from deltaswarm_cluster.plan import (
    NOTHING,
    ClusterError,
    Installed,
    Worker,
    WorkerLostError,
    check_installed,
    check_reached,
    in_order,
)
from deltaswarm_orchestrator.base import inputs, provenance
from deltaswarm_orchestrator.base.exits import FAILED
from deltaswarm_orchestrator.base.inputs import InputsChangedError
from deltaswarm_wire import __version__
from deltaswarm_wire.access import TLS
from deltaswarm_wire.session import host_and_port

POLL_S = 0.2
SILENCE_S = 30.0
"""A worker that does not answer for this long is lost [s]."""

CONNECT_WITHIN_S = 10.0
REACH_WITHIN_S = 5.0
PACKAGES = ("deltaswarm", "deltaswarm_wire")
"""The distribution, and a module with its version."""

PRIVATE = ("tls://", "tcp://127.")
"""How addresses of schedulers begin whose links are encrypted or within this machine."""


class DaskHost:
    """The host on one worker: an actor, which Dask neither moves nor starts again."""

    def __init__(self, client: Client, worker: Worker, is_there: Callable[[Worker], bool]) -> None:
        self.worker = worker
        self._client = client
        self._is_there = is_there
        self._future: Any = None
        self._actor: Any = None
        self._call: Any = None
        self._called_at = 0.0

    def start(self, job: Job) -> None:
        """Submit the actor, to this worker and no other, without retries."""
        place = {"workers": [self.worker.address], "allow_other_workers": False, "retries": 0}
        self._future = self._client.submit(HostActor, job, pure=False, actor=True, **place)

    def poll(self) -> News:
        """Return what the last call of the actor brought, if it has, and make the next one."""
        if self._actor is None:
            self._await_actor()
            return []
        if self._future.status != "finished":
            raise WorkerLostError
        now, news = time.monotonic(), []
        if self._call is not None and self._call.done():
            try:
                news = self._call.result()
            except Exception as error:  # whatever its worker, the scheduler or Dask's own code raised
                raise WorkerLostError(str(error)) from None
            self._call = None
        if self._call is None and now - self._called_at > POLL_S:
            self._call, self._called_at = self._method("poll"), now
        if self._call is not None and now - self._called_at > SILENCE_S:
            raise WorkerLostError(f"no answer for {SILENCE_S:g} s")
        return list(news)

    def _await_actor(self) -> None:
        try:
            is_there = self._is_there(self.worker)
            if is_there and self._future.done():
                self._actor = self._future.result()
        except (Exception, CancelledError) as error:  # the actor's own, or whatever Dask's code raises
            raise WorkerLostError(f"{type(error).__name__}: {error}") from None
        if not is_there:
            raise WorkerLostError("it has left the cluster")

    def stop(self) -> None:
        self._method("stop")

    def close(self) -> None:
        """Release the actor: nobody else holds it, so its worker drops it."""
        self._future = self._actor = self._call = None

    def _method(self, name: str) -> Any:
        try:
            return getattr(self._actor, name)()
        except RuntimeError as error:  # Dask knows that the worker is lost
            raise WorkerLostError(str(error)) from None


class DaskCluster:
    """The workers that a scheduler has when a run begins."""

    def __init__(self, client: Client, scheduler: str) -> None:
        self._client: Any = client  # its methods are typed for coroutines, too
        self._scheduler = scheduler
        self._present: Container[str] = ()
        self._asked_at = -POLL_S
        if not self._ask_dask(client.nthreads):
            raise ClusterError(
                f"the Dask scheduler at {scheduler} must have at least one worker; start some: dask worker {scheduler}"
            )
        self._check_packages()  # first: without deltaswarm, a worker could not even tell its name
        found = self._ask_workers(_name_and_installed)
        self.workers = in_order(Worker(str(name), address) for address, (name, _) in found.items())
        check_installed(_installed(), {worker: found[worker.address][1] for worker in self.workers})

    def _check_packages(self) -> None:
        """Check by Dask's own means that scheduler and workers have this deltaswarm and this Python."""
        found = self._ask_dask(self._client.get_versions, packages=PACKAGES)
        machines = {Worker(address, address): packages_of(has) for address, has in found["workers"].items()}
        machines[Worker("the scheduler", self._client.scheduler.address)] = packages_of(found["scheduler"])
        check_installed(packages_of(found["client"]), machines)

    def _ask_workers(self, function: Callable[..., Any], *arguments: object) -> dict[str, Any]:
        """Call a function on each worker; return its results by address."""
        hint = "; is this machine's deltaswarm, from the same sources, installed on all of them?"
        return dict(self._ask_dask(self._client.run, function, *arguments, hint=hint))

    def _ask_dask(self, call: Callable[..., Any], *arguments: object, hint: str = "", **more: object) -> Any:
        try:
            return call(*arguments, **more)
        except (Exception, CancelledError) as error:  # whatever a worker or Dask's own code raised
            raise ClusterError(f"the workers of {self._scheduler} could not be asked ({error}){hint}", FAILED) from None

    def check_controller(self, mode: str) -> None:
        """Check that all workers have a controller's files as this machine has them."""
        here = inputs.of_controller(mode)
        for address, there in self._ask_workers(inputs.of_controller, mode).items() if here else ():
            if other := inputs.differences(here, there):
                raise InputsChangedError(f"the files of {mode} must be the same here and on {address} (not: {other})")

    @property
    def problem(self) -> str:
        """Why the cluster is lost, or "" while it is not."""
        return "" if self._client.status == "running" else f"no connection to {self._scheduler}"

    @property
    def is_private(self) -> bool:
        """Whether what is sent to the workers, such as the agents' keys, is encrypted or stays on this machine."""
        return str(self._client.scheduler.address).startswith(PRIVATE)

    def host(self, worker: Worker) -> DaskHost:
        return DaskHost(self._client, worker, self._has)

    def _has(self, worker: Worker) -> bool:
        """Whether the worker is in the cluster; the scheduler is asked every `POLL_S`, for all workers at once."""
        if (now := time.monotonic()) - self._asked_at >= POLL_S:
            self._present, self._asked_at = self._client.nthreads(), now
        return worker.address in self._present

    def endpoint(self, listen: str) -> str:
        """Return where the world is to listen: as asked, or at this machine's address towards the scheduler."""
        host, port = host_and_port(listen) if listen else (self._own_address(), 0)
        try:
            # It never accepts: the kernel connects, as many as the backlog has room for.
            with socket.create_server((host, port), backlog=len(self.workers)) as server:
                problems = self._ask_workers(problem_to_reach, host, server.getsockname()[1])
        except OSError as error:
            raise ClusterError(
                "--listen must be an address of this machine with a free port "
                f"(got {TLS}/{host}:{port}: {os.strerror(error.errno) if error.errno else error})"
            ) from None
        endpoint = f"{TLS}/{host}:{port}"
        check_reached(endpoint, {worker: problems[worker.address] for worker in self.workers})
        return endpoint

    def _own_address(self) -> str:
        """Return this machine's address on the way to the scheduler; nothing is sent."""
        there = urlsplit(str(self._client.scheduler.address))
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
                way.connect((there.hostname, there.port))
                return str(way.getsockname()[0])
        except OSError as error:
            raise ClusterError(
                f"--listen must be given, since this machine's address towards {self._scheduler} is not known ({error})"
            ) from None


def silence_dask() -> None:
    """Let our one-line errors replace the tracebacks that Dask logs, and its table of other packages' versions."""
    warnings.simplefilter("ignore", VersionMismatchWarning)
    for name in ("distributed", "distributed.client", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


class _Client(Client):
    """Closed if it cannot connect: if one of Dask's threads collected it later, that might deadlock."""

    def __init__(self, address: object, within_s: float) -> None:
        try:
            super().__init__(address, timeout=within_s)  # type: ignore[no-untyped-call]
        except BaseException:
            with suppress(AttributeError):  # the address was refused before there was anything to close
                self.close()  # type: ignore[no-untyped-call]
            raise


@contextmanager
def client_of(address: object, within_s: float = CONNECT_WITHIN_S) -> Iterator[Client]:
    """Connect a client to the scheduler at an address, or to that of a cluster of this process.

    Raises:
        ConnectionError: there is none that can be reached; the text says why.
    """
    problem = ""
    try:
        client = _Client(address, within_s)
    except Exception as error:  # whatever Dask's own code raises, such as TypeError without its settings for TLS
        problem = str(error) or type(error).__name__
    if problem:
        raise ConnectionError(problem)
    with client:
        yield client


@contextmanager
def connected(scheduler: str) -> Iterator[DaskCluster]:
    """Connect to the scheduler of a run, whose workers are checked. Raises ClusterError."""
    silence_dask()
    with ExitStack() as stack:
        try:
            client = stack.enter_context(client_of(scheduler))
        except ConnectionError as error:
            raise ClusterError(
                f"no Dask scheduler could be reached at {scheduler}: {error}; start one: dask scheduler"
            ) from None
        yield DaskCluster(client, scheduler)


def packages_of(has: Mapping[str, Any]) -> Installed:
    """Read what Dask tells of a machine. Its newer versions ask for distributions, older ones for modules."""
    deltaswarm = next((found for name in PACKAGES if (found := has["packages"].get(name))), NOTHING)
    return Installed(deltaswarm, ".".join(has["host"]["python"].split(".")[:2]))


def _installed() -> Installed:
    python = ".".join(map(str, sys.version_info[:2]))
    return Installed(__version__, python, version("eclipse-zenoh"), provenance.code_digest())


def _name_and_installed(dask_worker: Any) -> tuple[object, Installed]:
    """Return a worker's name and what it has; Dask passes the worker by this argument's name."""
    return dask_worker.name, _installed()


async def problem_to_reach(host: str, port: int) -> str:
    """Say why this machine cannot connect to a port, or "" if it can."""
    try:
        _, writer = await asyncio.wait_for(asyncio.open_connection(host, port), REACH_WITHIN_S)
    except TimeoutError:
        return f"no answer from {host}:{port} within {REACH_WITHIN_S:g} s"
    except OSError as error:  # asyncio puts its own words in place of the system's
        return f"{os.strerror(error.errno) if error.errno else error} ({host}:{port})"
    writer.close()
    return ""
