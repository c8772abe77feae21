"""What is derived from the run's seed, one way, so that an agent that is told a part cannot compute the rest.

The agents' seeds, the ids of events and the world's own generators come from here. From its seed an agent cannot find
the run's, and with it the start places and the arrivals, except by trying seeds, each of which takes a scrypt.
"""

import hashlib
from functools import lru_cache

_COST, _BLOCK, _LANES = 2**15, 8, 1
"""About 0.1 s and 32 MB for each seed that is tried."""


@lru_cache(maxsize=256)
def _run_key(seed: int) -> bytes:
    return hashlib.scrypt(
        seed.to_bytes(8, "little"), salt=b"deltaswarm run", n=_COST, r=_BLOCK, p=_LANES, maxmem=128 * 2**20, dklen=32
    )


def derived_key(seed: int, use: str) -> bytes:
    """A key of 32 bytes for one use of a run with this seed."""
    return hashlib.blake2b(use.encode(), key=_run_key(seed), digest_size=32).digest()


def agent_seed(seed: int, agent: int) -> int:
    """The seed that one agent of a run is given: 63 bits."""
    return int.from_bytes(derived_key(seed, f"agent {agent}")[:8], "little") >> 1
