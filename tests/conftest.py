"""How properties are searched, and what signals do, for all tests."""

import os
import signal

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

# Whoever starts the tests in the background, or by nohup, has these ignored, and so would every process of a test.
for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)
