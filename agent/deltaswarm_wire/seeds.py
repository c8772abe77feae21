"""What is derived from the run's seed, one way, so that whoever is told a part cannot compute the rest.

An agent's own generator, and the ids of events, come from here. From either nobody can find the run's seed,
and with it the start places and the arrivals, except by trying seeds, each of which takes a scrypt.
"""

import hashlib
from functools import lru_cache

_COST, _BLOCK, _LANES = 2**14, 8, 1
"""About 40 ms and 16 MB for each seed that is tried."""


@lru_cache(maxsize=64)
def _run_key(seed: int) -> bytes:
    return hashlib.scrypt(
        seed.to_bytes(8, "little"), salt=b"deltaswarm run", n=_COST, r=_BLOCK, p=_LANES, maxmem=64 * 2**20, dklen=32
    )


def derived_key(seed: int, use: str) -> bytes:
    """A key of 32 bytes for one use of a run with this seed."""
    return hashlib.blake2b(use.encode(), key=_run_key(seed), digest_size=32).digest()


def agent_seed(seed: int, agent: int) -> int:
    """The seed that one agent of a run is given: 63 bits."""
    return int.from_bytes(derived_key(seed, f"agent {agent}")[:8], "little") >> 1
