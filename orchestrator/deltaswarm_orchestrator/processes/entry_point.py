"""Entry point of every started process. It imports little, because every agent pays for it."""

import gc
import importlib
import logging
import os
import shutil
import signal
import socket
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base.kernel import signal_at_parents_death
from deltaswarm_orchestrator.base.limits import reached
from deltaswarm_wire.child import LIMIT_REACHED, READY_VARIABLE, exit_code_of, leave
from deltaswarm_wire.session import PASSWORD_VARIABLE

GC_THRESHOLD = 100_000
"""The hot path makes no reference cycles; rare collections keep the memory of many processes out of the caches."""

FORK_SERVER: Any = forkserver._forkserver
"""Python's fork server. That nothing outlives a run depends on private names of it, which `fork_server.py` checks."""

SECRETS_VARIABLE = "DELTASWARM_SECRETS"
"""The environment variable with the folder of private keys that go with whoever started this process."""

GRACE_S = 3.0
"""Time that a part has to write its results after its orchestrator died [s]."""


class Inherited(NamedTuple):
    """What a part inherits from the orchestrator, open."""

    lifeline: Connection
    """The reading end of a pipe that only the orchestrator can write to: it closes with it, even by kill -9."""
    ready: Connection | None = None
    """The pipe of `say_ready`, if there is one."""
    channels: Mapping[str, socket.socket] = {}
    """The part's ends of socket pairs between operator and pages, by the options that name their descriptors."""


def main(
    module: str, argv: Sequence[str], password: str, log_file: Path, inherited: Inherited, *, in_background: bool
) -> None:
    """Run `module.main(argv)` with its own log, and never outlive the orchestrator.

    `in_background` is for all parts but the world.
    """
    if in_background:
        run_in_background()
    sys.excepthook = sys.__excepthook__  # not the fork server's
    gc.freeze()
    gc.set_threshold(GC_THRESHOLD)
    _wake_at_the_end()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the fork server's own session has no terminal
    try:
        _redirect(log_file)
    except OSError as error:  # the run has just ended, or the disk is full
        sys.exit(exit_code_of(error))
    logging.raiseExceptions = False  # logging fails on a full disk, which the exit code reports
    if password:
        os.environ[PASSWORD_VARIABLE] = password
    if inherited.ready is not None:
        os.environ[READY_VARIABLE] = str(os.dup(inherited.ready.fileno()))
        inherited.ready.close()
    for option, channel in inherited.channels.items():
        argv = [*argv, option, str(channel.detach())]
    try:
        threading.Thread(target=_follow, args=(inherited.lifeline,), daemon=True).start()
        code = importlib.import_module(module).main(argv)
    except BaseException as error:  # Zenoh's threads fail by a panic, which is no Exception
        if (limit := reached(error)) is None:
            raise
        print(limit, file=sys.stderr)
        code = LIMIT_REACHED
    leave(code)
    sys.exit(code)


def run_in_background() -> None:
    """Keep this process from preempting another when a message wakes it.

    The world hands out all frames of a step before the agents take the cores, which saves a third of the context
    switches.
    """
    if hasattr(os, "SCHED_BATCH"):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def _wake_at_the_end() -> None:
    """Have the kernel continue this process, if it is stopped, when the orchestrator ends, so that it ends as well.

    The fork server ends with the last process that holds its alive descriptor. That must be the orchestrator.
    """
    if (descriptor := FORK_SERVER._forkserver_alive_fd) is not None:
        os.close(descriptor)
        FORK_SERVER._forkserver_alive_fd = None
    signal_at_parents_death(signal.SIGCONT, os.getppid())


def _redirect(log_file: Path) -> None:
    log = os.open(log_file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.close(log)


def _follow(lifeline: Connection) -> None:
    try:
        lifeline.recv_bytes()
    except (EOFError, OSError):
        remove_socket_folder()
        remove_secrets()
        os.killpg(0, signal.SIGCONT)  # wakes all parts: a frozen one cannot notice the end
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE_S)
        os._exit(1)


def remove_secrets() -> None:
    if folder := os.environ.get(SECRETS_VARIABLE):
        for file in Path(folder).glob("*.key"):
            file.unlink(missing_ok=True)


def remove_socket_folder() -> None:
    """Remove the folder of the fork server's socket; an orchestrator that is killed does not do so itself."""
    if address := FORK_SERVER._forkserver_address:
        shutil.rmtree(os.path.dirname(address), ignore_errors=True)
