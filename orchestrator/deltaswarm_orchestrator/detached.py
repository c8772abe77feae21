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

ORCHESTRATOR = os.getppid()


@atexit.register
def tidy() -> None:
    """Remove the folder of the fork server's socket, where the orchestrator was killed and cannot."""
    address = getattr(forkserver._forkserver, "_forkserver_address", None)
    if os.getppid() != ORCHESTRATOR and address:
        shutil.rmtree(os.path.dirname(address), ignore_errors=True)
