"""Engines that do the runs of a sweep: worker processes on this machine, this process, or an extension's."""

import contextlib
import multiprocessing
import os
import signal
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Protocol

from deltaswarm_orchestrator.base import inputs
from deltaswarm_orchestrator.base.exits import CommandError, notices_are_shown, show_notices
from deltaswarm_orchestrator.base.inputs import InputsChangedError
from deltaswarm_orchestrator.base.kernel import signal_at_parents_death
from deltaswarm_orchestrator.base.signals import starting_processes
from deltaswarm_orchestrator.processes.fork_server import bare_main_module
from deltaswarm_orchestrator.sweeps.job import (
    PROCESSES,
    WAKE_EVERY_S,
    DisturbedError,
    Look,
    Result,
    RunError,
    Task,
    how_ended,
    nothing_more,
    work,
)
from deltaswarm_wire.plugin_errors import blamed

ATTEMPTS = 2
"""A run whose worker was killed is repeated once: the signal may have been meant for another process."""


class EngineError(CommandError):
    """The engine is not available."""


class EngineLostError(EngineError):
    """The engine was lost during the sweep; the runs that it finished are kept."""


@dataclass(frozen=True)
class Done:
    """A run that ended, with its result or the reason why it has none."""

    task: Task
    result: Result | None
    reason: str = ""
    ends_sweep: bool = False
    """Whether no other run can be used either, since a file that decides them is no longer as it was."""


class Engine(Protocol):
    """Does runs side by side, in any order."""

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        """Yield each task once, as it ends; abandon unfinished runs when the caller stops."""


class LocalEngine:
    """A pool of worker processes, each of which does one run after another."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._context = multiprocessing.get_context("spawn")

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        waiting = deque((task, 1) for task in tasks)
        busy: dict[Connection, _Worker] = {}
        try:
            while waiting or busy:
                idle = [worker for worker in busy.values() if worker.task is None]
                while waiting and (idle or len(busy) < self._workers):
                    with starting_processes(), bare_main_module():
                        worker = idle.pop() if idle else _Worker(self._context)
                        busy[worker.connection] = worker
                    worker.assign(*waiting.popleft())
                if not waiting:
                    for worker in [worker for worker in busy.values() if worker.task is None]:
                        busy.pop(worker.connection).stop()
                    if not busy:
                        break
                ended = wait(list(busy), WAKE_EVERY_S)
                for worker in () if ended else busy.values():
                    worker.resume()
                for connection in ended:
                    worker = busy[connection]  # type: ignore[index]  # only connections were given
                    task, attempt = worker.task, worker.attempt
                    assert task is not None
                    try:
                        attempted = worker.connection.recv()
                    except (EOFError, OSError):
                        how = busy.pop(worker.connection).stop()
                        if attempt < ATTEMPTS:
                            waiting.appendleft((task, attempt + 1))
                        else:
                            yield Done(task, None, f"its process {how}, {attempt} times")
                        continue
                    worker.task = None
                    yield Done(task, *attempted)
        finally:
            for worker in busy.values():
                worker.stop()


class _Worker:
    def __init__(self, context: multiprocessing.context.SpawnContext) -> None:
        self.connection, theirs = context.Pipe()
        self.task: Task | None = None
        self.attempt = 0
        arguments = (theirs, os.getpid(), notices_are_shown())
        self._process: SpawnProcess = context.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        theirs.close()

    def assign(self, task: Task, attempt: int) -> None:
        self.task, self.attempt = task, attempt
        with contextlib.suppress(OSError):  # it has died; the next `wait` reports that
            self.connection.send(task)

    def resume(self) -> None:
        if self._process.pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._process.pid, signal.SIGCONT)

    def stop(self) -> str:
        self.connection.close()
        self._process.join(0.2 if self.task is None else 0)
        self._process.kill()
        self._process.join()
        return how_ended(self._process.exitcode or 0)


def _serve(connection: Connection, parent: int, with_notices: bool) -> None:
    show_notices(with_notices)
    signal_at_parents_death(signal.SIGKILL, parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C is for the parent; a run's processes unblock it
    while True:
        try:
            task = connection.recv()
        except EOFError:
            return
        connection.send(attempt(task))


class ThisProcess:
    """Does one run after another in this process, which may hold classes and metrics that no other process can import.

    Args:
        look: returns more numbers for the summary of a run, by name.
    """

    def __init__(self, look: Look) -> None:
        self._look = look

    def run(self, tasks: Sequence[Task]) -> Iterator[Done]:
        for task in tasks:
            yield Done(task, *attempt(task, self._look))


def attempt(task: Task, look: Look = nothing_more) -> tuple[Result | None, str, bool]:
    """Do a run, again if it was disturbed; return what `Done` says about it.

    Its inputs must be those of the sweep before it and after it: a run with any other is not used.
    """
    reason = ""
    for _ in range(ATTEMPTS):
        try:
            inputs.check(task.job.scenario, task.job.inputs, starts_python=task.means == PROCESSES)
            try:
                return work(task, look), "", False
            finally:
                inputs.check(task.job.scenario, task.job.inputs, starts_python=task.means == PROCESSES)
        except InputsChangedError as error:
            return None, str(error), True
        except DisturbedError as error:
            reason = f"{ATTEMPTS} times disturbed; the last time {error}"
        except RunError as error:
            return None, str(error), False
        except Exception as error:
            plugin = blamed(error)
            return None, plugin.report if plugin else traceback.format_exc(), False
    return None, reason, False
