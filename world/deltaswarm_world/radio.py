"""The air between the radios: who hears whom, and if not, why not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deltaswarm_wire.settings import RadioSettings
from deltaswarm_world.density import Floats


@dataclass(frozen=True)
class Reception:
    """What became of the frames of one step.

    `links` are (sender, receiver) pairs in order of receiver, then sender; the rest are counts of
    (frame, receiver) pairs by the reason why there was no reception.
    """

    links: list[tuple[int, int]]
    dropped_range: int
    dropped_loss: int
    dropped_dead: int


SILENCE = Reception([], 0, 0, 0)


class RangeDisc:
    """A frame is heard within a range, unless it is lost by chance, independently per receiver."""

    def __init__(self, settings: RadioSettings, rng: np.random.Generator) -> None:
        self._range_m2 = settings.range_m**2
        self._loss = settings.loss
        self._rng = rng

    def receive(self, positions_m: Floats, senders: Sequence[int], present: list[bool]) -> Reception:
        """Who hears the frames of `senders` (agents, ascending), given positions (n, 2) and who is there."""
        if not senders:
            return SILENCE
        offsets = positions_m[:, None, :] - positions_m[None, list(senders), :]
        heard = np.einsum("ijk,ijk->ij", offsets, offsets) <= self._range_m2
        heard[senders, range(len(senders))] = False
        absent = len(present) - sum(present)
        if absent:
            heard[[agent for agent, there in enumerate(present) if not there]] = False
        in_range = int(np.count_nonzero(heard))
        if self._loss > 0.0:
            lost = self._rng.random(in_range) < self._loss
            heard[heard] = ~lost
        receivers, columns = (axis.tolist() for axis in heard.nonzero())
        links = [(senders[column], receiver) for receiver, column in zip(receivers, columns, strict=True)]
        pairs = len(senders) * (len(present) - 1)
        dead = sum(absent - (not present[sender]) for sender in senders)
        return Reception(links, pairs - dead - in_range, in_range - len(links), dead)
