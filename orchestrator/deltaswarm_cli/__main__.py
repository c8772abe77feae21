"""Start of the command `deltaswarm`: signal handlers and streams first, then everything else."""

import os
import sys

from deltaswarm_orchestrator.base.signals import end_at_once_on_signals


def main() -> int:
    """Run one command; return its exit code. Slow imports come after the signal handlers are set."""
    end_at_once_on_signals()
    from deltaswarm_orchestrator.base.output import open_outputs

    open_outputs()
    # No array here is large enough for a second OpenBLAS thread, and the threads started by importing numpy spin for
    # 0.1 s in every process. Set before that import; the parts of a run inherit it.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    import atexit

    from deltaswarm_cli import main as cli
    from deltaswarm_wire.child import leave

    code = cli.main()
    leave(code, atexit._run_exitfuncs)
    return code


if __name__ == "__main__":
    sys.exit(main())
