"""How properties are searched, for all tests."""

import os

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
