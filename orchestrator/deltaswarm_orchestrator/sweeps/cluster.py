"""A sweep on a Dask cluster: a local one, or whichever its deployers made of SLURM, SSH or Kubernetes."""

import atexit
import functools
import gc
import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack
from dataclasses import replace

import dask
from distributed import Client, LocalCluster, as_completed
from distributed.deploy.spec import close_clusters

from deltaswarm_orchestrator import provenance
from deltaswarm_orchestrator.exits import complain
from deltaswarm_orchestrator.sweeps.engine import ATTEMPTS, Done, EngineError, EngineLostError, attempt
from deltaswarm_orchestrator.sweeps.work import Result, Task

CONNECT_WITHIN_S = 10.0


# The stack closes the cluster. What Dask does at exit would only add a traceback where Ctrl-C came before it was up.
atexit.unregister(close_clusters)


class DaskEngine:
    """Gives all runs to a Dask scheduler, which gives them to its workers, and again if a worker is lost.

    How often a run may lose its worker is the scheduler's `allowed-failures`; a local cluster's is ours.
    """

    def __init__(self, scheduler: str | None, workers: int) -> None:
        self._scheduler = scheduler
        self._workers = workers

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        """Each task once, as it ends.

        Raises:
            EngineError: there is no scheduler at the address.
            EngineLostError: there is none any more.
        """
        for name in ("distributed", "distributed.client", "asyncio"):  # their tracebacks say less than our one line
            logging.getLogger(name).setLevel(logging.CRITICAL)
        with dask.config.set({"distributed.scheduler.allowed-failures": ATTEMPTS - 1}), ExitStack() as stack:
            client = self._client(stack)
            if self._scheduler and not client.nthreads():
                complain(f"the Dask scheduler at {self._scheduler} has no workers yet; waiting for them")
            code = provenance.code_digest()
            futures = {
                client.submit(attempt_with, code, replace(task, scratch=None), pure=False, key=_key(code, task)): task
                for task in tasks
            }
            waiting = as_completed(list(futures))
            for future in waiting:
                task = futures.pop(future)
                try:
                    error = future.exception()
                    result, reason = (None, f"{type(error).__name__}: {error}") if error else future.result()
                except CancelledError:  # by nobody but a client that lost its scheduler
                    raise EngineLostError(f"the Dask scheduler at {self._scheduler} was lost") from None
                yield Done(task, result, reason)
                future.release()

    def _client(self, stack: ExitStack) -> Client:
        """A client that the stack closes, and the local cluster with it if there is one."""
        try:
            address = self._scheduler or stack.enter_context(
                LocalCluster(
                    n_workers=self._workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
                )
            )
            client: Client = stack.enter_context(Client(address, timeout=CONNECT_WITHIN_S))
            return client
        except (OSError, ValueError, AssertionError) as error:  # the last: Dask's own thread was not up within 10 s
            problem = str(error)
        gc.collect()  # a client that did not connect closes as it is collected: in a thread of Dask's that may deadlock
        raise EngineError(f"no Dask scheduler could be reached at {self._scheduler or 'this machine'}: {problem}")


def _key(code: str, task: Task) -> str:
    """Same key, same result: a scheduler gives all its clients one that it has."""
    return f"deltaswarm-{code}-{task.job.key}-{task.means}"


def attempt_with(code: str, task: Task) -> tuple[Result | None, str]:
    """A run's result by a worker that has the same code as we have; else the reason why there is none."""
    own = _own_code()
    if own != code:
        return None, f"the Dask worker has another deltaswarm (code {own}, here {code}); install the same on both"
    return attempt(task)


@functools.cache
def _own_code() -> str:
    return provenance.code_digest()
