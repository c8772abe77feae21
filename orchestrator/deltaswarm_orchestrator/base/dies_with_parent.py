"""Run a module that ends with the process that started it, even if that process is killed with -9: PID MODULE ..."""

import runpy
import signal
import sys

from deltaswarm_orchestrator.base.kernel import signal_at_parents_death

if __name__ == "__main__":
    signal_at_parents_death(signal.SIGTERM, int(sys.argv[1]))
    module = sys.argv[2]
    sys.argv[1:] = sys.argv[3:]
    runpy.run_module(module, run_name="__main__")
