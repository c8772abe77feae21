"""A process of a measurement: a terminal's Ctrl-C does not reach it, and it never outlives this process."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.kernel import signal_at_parents_death
from deltaswarm_orchestrator.base.starting import starting_processes
from deltaswarm_orchestrator.processes.fork_server import bare_main_module, safe_path

END_WITHIN_S = 5.0
"""Time that a process may take to end after its connection has [s]."""


@contextmanager
def child(target: Callable[..., None], *arguments: object) -> Iterator[Connection]:
    """Run `target(connection, *arguments)` in a fresh process that is killed with the block; yield the other end.

    Raises:
        CommandError: the block met the end of the connection, so the process had ended.
    """
    context = multiprocessing.get_context("spawn")  # the caller has threads
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(os.getpid(), target, theirs, *arguments), daemon=True)
    try:
        with starting_processes(), bare_main_module(), safe_path():
            process.start()
        theirs.close()
        yield ours
    except EOFError:
        process.join(END_WITHIN_S)
        if process.exitcode is None:  # it was another's connection
            raise
        raise CommandError(f"a process of the measurement ended with exit code {process.exitcode}", FAILED) from None
    finally:
        ours.close()
        if process.pid is not None:
            process.kill()
            process.join()


def _work(parent: int, target: Callable[..., None], *arguments: object) -> None:
    signal_at_parents_death(signal.SIGKILL, parent)
    target(*arguments)
