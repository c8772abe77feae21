"""Opaque ids of events: an id does not reveal how many events there have been."""

import hashlib

from deltaswarm_wire.seeds import derived_key

ROUNDS = 4
_HALF_BITS = 16
_HALF = (1 << _HALF_BITS) - 1


class EventIds:
    """A keyed permutation of the numbers below 2^32 (a Feistel network), the same for the same seed of the run."""

    def __init__(self, seed: int) -> None:
        self._key = derived_key(seed, "event ids")

    def of(self, number: int) -> int:
        """Return the id of the n-th event to arrive, counted from 0."""
        left, right = number >> _HALF_BITS, number & _HALF
        for turn in range(ROUNDS):
            left, right = right, left ^ self._mixed(turn, right)
        return left << _HALF_BITS | right

    def _mixed(self, turn: int, half: int) -> int:
        data = bytes((turn, half & 0xFF, half >> 8))
        return int.from_bytes(hashlib.blake2b(data, key=self._key, digest_size=2).digest(), "little")
