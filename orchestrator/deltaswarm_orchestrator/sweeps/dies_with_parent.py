"""A `deltaswarm` command that ends with the process that started it, even if that process is killed with -9."""

import runpy
import signal
import sys

from deltaswarm_orchestrator.base.kernel import signal_at_parents_death

if __name__ == "__main__":
    signal_at_parents_death(signal.SIGTERM, int(sys.argv[1]))
    sys.argv[1:] = sys.argv[2:]
    runpy.run_module("deltaswarm_orchestrator", run_name="__main__")
