"""Imported by the fork server alone, for its effect: a session of its own.

Signals to the terminal's or the orchestrator's process group then reach the orchestrator only, which
sees to an orderly end. A fork server that such a signal ended would take its children's exit codes along.
"""

import os

if os.getpid() != os.getsid(0):
    os.setsid()
