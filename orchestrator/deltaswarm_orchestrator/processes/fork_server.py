"""The fork server that starts all parts, kept clean of this program's own arguments and folder."""

import os
import select
import signal
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import forkserver

DEAD_WITHIN_MS = 5000


def _pid() -> int | None:
    return getattr(forkserver._forkserver, "_forkserver_pid", None)


def wake_fork_server() -> None:
    """Continue the fork server, if somebody has stopped it."""
    if pid := _pid():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def kill_fork_server() -> None:
    """Kill the fork server in whatever state it is, and wait for its end; the next start creates a new one."""
    if pid := _pid():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
            poll = select.poll()
            poll.register(handle := os.pidfd_open(pid), select.POLLIN)
            poll.poll(DEAD_WITHIN_MS)
            os.close(handle)


@contextmanager
def bare_main_module() -> Iterator[None]:
    """Hide the program's own main module and arguments, which every started process would get.

    With the module, each agent would import the whole command line; with the arguments, it would learn the run's seed
    and scenario.
    """
    main, argv = sys.modules["__main__"], sys.argv
    sys.modules["__main__"], sys.argv = types.ModuleType("__main__"), argv[:1]
    try:
        yield
    finally:
        sys.modules["__main__"], sys.argv = main, argv


@contextmanager
def safe_path() -> Iterator[None]:
    """Start the fork server without the current folder on its path, which may hold a folder named `operator`."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before
