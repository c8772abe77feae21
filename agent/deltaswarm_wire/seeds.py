"""One-way derivation of keys from the run's seed.

The agents' seeds, the ids of events and the world's own generators come from here. An agent cannot compute the run's
seed from its own, and with it start positions and arrivals, except by trying seeds at the cost of one scrypt each.
"""

import hashlib
from functools import lru_cache

_COST, _BLOCK, _LANES = 2**15, 8, 1
"""About 0.1 s and 32 MB for each seed."""


@lru_cache(maxsize=256)
def _run_key(seed: int) -> bytes:
    return hashlib.scrypt(
        seed.to_bytes(8, "little"), salt=b"deltaswarm run", n=_COST, r=_BLOCK, p=_LANES, maxmem=128 * 2**20, dklen=32
    )


def derived_key(seed: int, use: str) -> bytes:
    """Derive a key of 32 bytes for one purpose from a run's seed."""
    return hashlib.blake2b(use.encode(), key=_run_key(seed), digest_size=32).digest()


def agent_seed(seed: int, agent: int) -> int:
    """Derive the seed of one agent: 63 bits."""
    return int.from_bytes(derived_key(seed, f"agent {agent}")[:8], "little") >> 1
