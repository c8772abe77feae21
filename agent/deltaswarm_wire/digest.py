"""The digest of a run: the same scenario and seed give the same one, whatever the scheduling.

World and operator each hash what they received, in step and agent order; the run's digest is the
hash of both parts.
"""

import hashlib
import struct

_head = struct.Struct("<IHBI").pack
ACT, RADIO, REPORT = 0, 1, 2


class Digest:
    """A running hash over (step, agent, kind, bytes), which must come in step and agent order."""

    def __init__(self) -> None:
        self._hash = hashlib.blake2b(digest_size=16)
        self._update = self._hash.update

    def add(self, step: int, agent: int, kind: int, data: bytes) -> None:
        """Take in one message."""
        self._update(_head(step, agent, kind, len(data)) + data)

    def hex(self) -> str:
        """The digest of all that was added so far."""
        return self._hash.hexdigest()


def combine(world: str, operator: str) -> str:
    """The run's digest from the digests of its two counting parts."""
    return hashlib.blake2b(f"{world}:{operator}".encode(), digest_size=16).hexdigest()
