"""Imported by the fork server alone, for its effect: a session of its own, and nothing left behind.

Signals to the terminal's or the orchestrator's process group then reach the orchestrator only, which
sees to an orderly end. A fork server that such a signal ended would take its children's exit codes along.
"""

import atexit
import os
import signal

from deltaswarm_orchestrator.parent import signal_at_parents_death
from deltaswarm_orchestrator.run.child import remove_socket_folder

if os.getpid() != os.getsid(0):
    os.setsid()

signal_at_parents_death(signal.SIGCONT, os.getppid())  # if it is stopped then, it must notice its end
atexit.register(remove_socket_folder)  # its children leave by `os._exit`, it with the orchestrator
