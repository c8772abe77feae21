"""The digest of a run: the same scenario and seed give the same one, whatever the scheduling.

World and operator each hash what they received, in step and agent order; the run's digest is the
hash of both parts.
"""

import hashlib
import struct

_head = struct.Struct("<IHBI").pack
ACT, RADIO, REPORT, COMMAND = 0, 1, 2, 3
SIZE_BYTES = 16


class Digest:
    """A hash over (step, agent, kind, bytes), which must come in step and agent order: a chain with a link per step.

    `state` is all that must be kept in order to go on later; what was added since the last `end_step` is not in it.
    """

    def __init__(self, state: bytes = bytes(SIZE_BYTES)) -> None:
        self.state = state
        self._parts: list[bytes] = []

    def add(self, step: int, agent: int, kind: int, data: bytes) -> None:
        """Take in one message."""
        self._parts += (_head(step, agent, kind, len(data)), data)

    def end_step(self) -> None:
        """Let the messages since the last call be one step's; a step without any leaves no trace."""
        if self._parts:
            self.state = hashlib.blake2b(b"".join((self.state, *self._parts)), digest_size=SIZE_BYTES).digest()
            self._parts.clear()

    def hex(self) -> str:
        """The digest of all steps that have ended."""
        return self.state.hex()


def combine(world: str, operator: str) -> str:
    """The run's digest from the digests of its two counting parts."""
    return hashlib.blake2b(f"{world}:{operator}".encode(), digest_size=SIZE_BYTES).hexdigest()
