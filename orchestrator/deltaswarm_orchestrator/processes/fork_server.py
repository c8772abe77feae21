"""The fork server that starts all parts, kept clean of this program's own arguments and folder."""

import multiprocessing
import os
import select
import signal
import sys
import tempfile
import types
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import util
from pathlib import Path

from deltaswarm_orchestrator.base.temporary import TemporaryFolder
from deltaswarm_orchestrator.processes.entry_point import FORK_SERVER

DEAD_WITHIN_MS = 5000

MAX_FOLDER = 55
"""Longest path of a folder for temporary files in which the fork server's socket has room: its path has 107 bytes."""

PRIVATE_NAMES = ("_forkserver_pid", "_forkserver_alive_fd", "_forkserver_address")
"""Attributes of Python's fork server by which no process outlives a run."""


def fork_server_problem() -> str:
    """Say which private name this Python's fork server lacks, as that of a later Python may; empty if none."""
    missing = [name for name in PRIVATE_NAMES if not hasattr(FORK_SERVER, name)]
    if not missing:
        return ""
    return (
        f"multiprocessing.forkserver must have {', '.join(missing)}, by which all processes end with their run "
        f"(Python {sys.version.split()[0]} has not); use Python 3.11, 3.12 or 3.13, or --in-process"
    )


def wake_fork_server() -> None:
    if pid := FORK_SERVER._forkserver_pid:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def kill_fork_server() -> None:
    """Kill the fork server in whatever state it is, and wait for its end; the next start creates a new one."""
    if pid := FORK_SERVER._forkserver_pid:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
            poll = select.poll()
            poll.register(handle := os.pidfd_open(pid), select.POLLIN)
            poll.poll(DEAD_WITHIN_MS)
            os.close(handle)


def place_sockets() -> None:
    """Let Python put its sockets into a folder that does not stay if this process is killed.

    It is below /tmp if the folder for temporary files has too long a path (`TMPDIR`). One that somebody has removed, as
    those do that clear /tmp, is replaced.
    """
    config = multiprocessing.current_process()._config  # type: ignore[attr-defined]
    if not os.path.isdir(config.get("tempdir") or ""):
        is_long = len(os.fsencode(tempfile.gettempdir())) > MAX_FOLDER
        folder = TemporaryFolder(Path("/tmp") if is_long else None)
        config["tempdir"] = str(folder.path)
        util.Finalize(None, TemporaryFolder.__exit__, args=(folder,), exitpriority=-100)  # which keeps it till then


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
