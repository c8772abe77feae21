"""Run a sweep on a Dask cluster: a local one, or one deployed on SLURM, SSH or Kubernetes."""

import atexit
import functools
import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import dask
from distributed import Client, LocalCluster, as_completed
from distributed.deploy.spec import close_clusters

from deltaswarm_cluster.dask_cluster import CONNECT_WITHIN_S, PACKAGES, client_of, packages_of, silence_dask
from deltaswarm_cluster.plan import NOTHING
from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.exits import FAILED, notice
from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_orchestrator.sweeps.engine import ATTEMPTS, Done, EngineError, EngineLostError, attempt
from deltaswarm_orchestrator.sweeps.job import Result, Task

# The exit stack closes the cluster. Dask's own exit handler would only add a traceback if Ctrl-C came during start-up.
atexit.unregister(close_clusters)


class DaskEngine:
    """Submits all runs to a Dask scheduler, which retries a run if its worker is lost.

    The scheduler's `allowed-failures` limits the retries; on a local cluster, `ATTEMPTS` sets it.
    """

    def __init__(self, scheduler: str | None, workers: int) -> None:
        self._scheduler = scheduler
        self._workers = workers

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        """Yield each task once, when it ends.

        Raises:
            EngineError: no scheduler can be reached at the address.
            EngineLostError: the scheduler was lost during the sweep.
        """
        silence_dask()
        with dask.config.set({"distributed.scheduler.allowed-failures": ATTEMPTS - 1}), ExitStack() as stack:
            client = self._client(stack, tasks)
            if self._scheduler:
                check_workers(client, self._scheduler)
            code = provenance.code_digest()
            futures = {}
            for task in tasks:
                # A scheduler shares a result with all clients that submit the same key.
                key = f"deltaswarm-{code}-{task.job.key}-{task.means}"
                futures[client.submit(attempt_with, code, replace(task, scratch=None), pure=False, key=key)] = task
            waiting = as_completed(list(futures))
            for future in waiting:
                task = futures.pop(future)
                try:
                    error = future.exception()
                    attempted = (None, f"{type(error).__name__}: {error}", False) if error else future.result()
                except CancelledError:  # only a client that lost its scheduler cancels
                    raise EngineLostError(f"the Dask scheduler at {self._scheduler} was lost") from None
                yield Done(task, *attempted)
                future.release()

    def _client(self, stack: ExitStack, tasks: Sequence[Task]) -> Client:
        """Connect a client, to a new local cluster if no scheduler is given; the stack closes both."""
        try:
            return stack.enter_context(client_of(self._scheduler or self._local(stack, tasks), CONNECT_WITHIN_S))
        except (OSError, ValueError, AssertionError, RuntimeError) as error:
            # AssertionError: Dask's thread was not up within 10 s; RuntimeError: a worker of a local cluster died.
            problem = str(error)
        if self._scheduler:
            raise EngineError(f"no Dask scheduler could be reached at {self._scheduler}: {problem}")
        raise EngineError(f"no Dask cluster could be started on this machine: {problem}", FAILED)

    def _local(self, stack: ExitStack, tasks: Sequence[Task]) -> LocalCluster:
        """Start a cluster on this machine, which the stack closes, with no more workers than tasks."""
        scratch = next((task.scratch for task in tasks), None)  # removed by the sweep, or by the next one after kill -9
        with starting_processes(), dask.config.set({"temporary-directory": scratch}):
            cluster: LocalCluster = stack.enter_context(
                LocalCluster(
                    n_workers=max(1, min(self._workers, len(tasks))),
                    threads_per_worker=1,
                    dashboard_address=None,
                    scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # else its HTTP server takes port 8787
                    silence_logs=logging.CRITICAL,
                )
            )
        return cluster


def check_workers(client: Client, scheduler: str) -> None:
    """Say that there are no workers yet, or refuse those that would crash for want of deltaswarm."""
    found: Any = client.get_versions(packages=PACKAGES)  # typed for coroutines too
    if not found["workers"]:
        notice(f"deltaswarm: the Dask scheduler at {scheduler} has no workers yet; waiting for them")
    lacking = [address for address, has in found["workers"].items() if packages_of(has).deltaswarm == NOTHING]
    if lacking:
        raise EngineError(f"all workers of {scheduler} must have deltaswarm (not installed at {', '.join(lacking)})")


def attempt_with(code: str, task: Task) -> tuple[Result | None, str, bool]:
    """Do a run if this worker's code has the digest `code`; return what `Done` says about it."""
    worker_code = _own_code()
    if worker_code == code:
        return attempt(task)
    codes = f"code {worker_code}, here {code}"
    return None, f"the Dask worker runs another version of deltaswarm ({codes}); install the same on both", False


@functools.cache
def _own_code() -> str:
    return provenance.code_digest()
