"""How properties are searched, what signals do and what is compiled only once, for all tests."""

import os
import signal
import sys

from hypothesis import HealthCheck, settings

# The gate tries the same examples each time; with DELTASWARM_EXPLORE=1 others, each time anew. A loaded machine
# is no failure; a failing example can be pasted from the log.
settings.register_profile(
    "deltaswarm",
    deadline=None,
    derandomize="DELTASWARM_EXPLORE" not in os.environ,
    suppress_health_check=[HealthCheck.too_slow],
    print_blob=True,
)
settings.load_profile("deltaswarm")

# The tests start more than a thousand processes. Without bytecode on disk each would compile deltaswarm anew, which
# takes longer than most of their runs; and pytest would rewrite every test file in every worker.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# OpenBLAS starts a thread per core when numpy is imported, and each spins for a while before it sleeps. Here for this
# process; `deltaswarm` does so for its own.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Whoever starts the tests in the background, or by nohup, has these ignored, and so would every process of a test.
for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)
