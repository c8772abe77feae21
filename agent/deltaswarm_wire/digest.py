"""The digest of a run: equal for equal scenario and seed, independent of scheduling.

World and operator each hash what they received, in step and agent order; the run's digest is the
hash of both parts.
"""

import hashlib
import struct
from collections.abc import Iterable

HEAD = struct.Struct("<IHBI")
"""What comes before each message: step, agent, kind, length [bytes]."""

ACT, RADIO, REPORT, COMMAND = 0, 1, 2, 3
SIZE_BYTES = 16


class Digest:
    """A hash chain over (step, agent, kind, bytes) in step and agent order, one link per step.

    `state` suffices to resume later; it excludes messages since the last `end_step`.
    """

    def __init__(self, state: bytes = bytes(SIZE_BYTES)) -> None:
        self.state = state
        self._parts: list[bytes] = []

    def add(self, step: int, agent: int, kind: int, data: bytes) -> None:
        self._parts += (HEAD.pack(step, agent, kind, len(data)), data)

    def end_step(self) -> None:
        """Close a step with the messages since the last call; a step without messages changes nothing."""
        if self._parts:
            self.state = next_link(self.state, self._parts)
            self._parts.clear()

    def hex(self) -> str:
        return self.state.hex()


def next_link(state: bytes, parts: Iterable[bytes | memoryview]) -> bytes:
    """Return the state of a chain after the messages of one more step, each with its head."""
    return hashlib.blake2b(b"".join((state, *parts)), digest_size=SIZE_BYTES).digest()


def of_numbers(numbers: Iterable[float]) -> str:
    """Return the digest of a policy's numbers."""
    return hashlib.blake2b(repr([float(number) for number in numbers]).encode(), digest_size=8).hexdigest()


def combine(world: str, operator: str) -> str:
    return hashlib.blake2b(f"{world}:{operator}".encode(), digest_size=SIZE_BYTES).hexdigest()
