"""Imported by the fork server alone, for its effect: start a session of its own, and clean up at exit.

Signals to the terminal's or the orchestrator's process group then reach the orchestrator only, which shuts down in
order. If such a signal ended the fork server, its children's exit codes would be lost.
"""

import atexit
import os
import signal
import sys
from types import TracebackType

from deltaswarm_orchestrator.base.kernel import signal_at_parents_death
from deltaswarm_orchestrator.processes.entry_point import remove_socket_folder


def _say_why(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    """Say that no more processes can be started; the orchestrator, which is still there, reports any other error.

    It also removes the socket's folder.
    """
    atexit.unregister(remove_socket_folder)
    if isinstance(error, OSError):
        print(f"deltaswarm: no more processes can be started: {error.strerror}", file=sys.stderr)


sys.excepthook = _say_why

if os.getpid() != os.getsid(0):
    os.setsid()

signal_at_parents_death(signal.SIGCONT, os.getppid())  # a stopped fork server must notice that it should end
atexit.register(remove_socket_folder)  # not run by its children, which leave by `os._exit`
