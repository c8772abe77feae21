"""The air between the radios: who hears whom, and if not, why not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deltaswarm_wire.settings import RadioSettings
from deltaswarm_world.density import Floats
from deltaswarm_world.near import near


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
        self._range_m = settings.range_m
        self._loss = settings.loss
        self._rng = rng

    def receive(self, positions_m: Floats, senders: Sequence[int], present: list[bool]) -> Reception:
        """Who hears the frames of `senders` (agents, ascending), given positions (n, 2) and who is there."""
        if not senders:
            return SILENCE
        speaking = np.array(senders)
        receivers, columns = near(positions_m, positions_m[speaking], self._range_m)
        speakers = speaking[columns]
        heard = speakers != receivers
        absent = present.count(False)
        if absent:
            heard &= np.array(present)[receivers]
        in_range = int(np.count_nonzero(heard))
        if self._loss > 0.0:
            heard[heard] = self._rng.random(in_range) >= self._loss
        links = list(zip(speakers[heard].tolist(), receivers[heard].tolist(), strict=True))
        pairs = len(senders) * (len(present) - 1)
        dead = sum(absent - (not present[sender]) for sender in senders) if absent else 0
        return Reception(links, pairs - dead - in_range, in_range - len(links), dead)
