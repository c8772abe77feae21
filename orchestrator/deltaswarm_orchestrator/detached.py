"""Imported by the fork server alone, for its effect: a session of its own, and nothing left behind.

Signals to the terminal's or the orchestrator's process group then reach the orchestrator only, which
sees to an orderly end. A fork server that such a signal ended would take its children's exit codes along.
"""

import atexit
import os
import shutil
from multiprocessing import forkserver

if os.getpid() != os.getsid(0):
    os.setsid()

FORK_SERVER = os.getpid()


@atexit.register
def tidy() -> None:
    """Remove the folder of the fork server's socket, which an orchestrator that was killed could not.

    The fork server ends with the orchestrator, which in an orderly end has removed the folder before. Who its parent
    is would tell nothing: a killed process still is the parent for a moment after its files are closed.
    """
    address = getattr(forkserver._forkserver, "_forkserver_address", None)
    if os.getpid() == FORK_SERVER and address:
        shutil.rmtree(os.path.dirname(address), ignore_errors=True)
