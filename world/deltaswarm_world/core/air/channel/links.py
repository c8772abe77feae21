"""The input of the models: frames on the air and the receivers in reach."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from deltaswarm_world.core.arrays import Floats, Indices, Mask

Hashes: TypeAlias = npt.NDArray[np.uint64]


class Ends(NamedTuple):
    """One side of the links: ids and positions (n, 2) [m; world frame] of agents or a base."""

    ids: Indices
    places_m: Floats


class Links:
    """Frames on the air with the receivers in reach: one row per pair, in order of receiver, then frame.

    Every model sees all rows, so that its draws do not depend on other models.

    Args:
        speakers: the sender of each frame, one row per frame, by sender, then age.
        listeners: possible receivers.
        frames: the encoded frames; optional if no model needs sizes.
        columns: the frame of each link, as a row of `speakers`.
        rows: the receiver of each link, as a row of `listeners`.
    """

    def __init__(
        self, speakers: Ends, listeners: Ends, frames: Sequence[bytes], columns: Indices, rows: Indices
    ) -> None:
        self.columns = columns
        self.senders: Indices = speakers.ids[columns]
        self.receivers: Indices = listeners.ids[rows]
        self.is_open: Mask = np.ones(len(columns), dtype=np.bool_)
        """Whether the frame is still received after the previous models."""
        self.spare_db: Floats | None = None
        """Received power above the sensitivity, if reach is by power."""
        self.rows = rows
        self._speakers, self._listeners, self._frames = speakers, listeners, frames

    @classmethod
    def of_pairs(cls, senders: Ends, receivers: Ends, frames: Sequence[bytes] = ()) -> Self:
        """Make links from senders and receivers, row by row."""
        each = np.arange(len(senders.ids))
        return cls(senders, receivers, frames, each, each)

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def has_twins(self) -> bool:
        """Whether a sender has more than one frame on the air."""
        ids = self._speakers.ids.tolist()
        return len(set(ids)) < len(ids)

    @cached_property
    def from_m(self) -> Floats:
        """Positions of senders (n, 2) [m]."""
        places_m: Floats = self._speakers.places_m[self.columns]
        return places_m

    @cached_property
    def to_m(self) -> Floats:
        """Positions of receivers (n, 2) [m]."""
        places_m: Floats = self._listeners.places_m[self.rows]
        return places_m

    @property
    def speakers_m(self) -> Floats:
        """Position of each row of `speakers` (n, 2) [m]."""
        return self._speakers.places_m

    @property
    def listeners_m(self) -> Floats:
        """Position of each row of `listeners` (n, 2) [m]."""
        return self._listeners.places_m

    @cached_property
    def sizes(self) -> Floats:
        """Length of each encoded frame [bytes]."""
        sizes: Floats = np.array([len(frame) for frame in self._frames], dtype=np.float64)[self.columns]
        return sizes

    @cached_property
    def distances_m(self) -> Floats:
        """Distance from sender to receiver [m]."""
        offsets = self.to_m - self.from_m
        dx, dy = offsets[:, 0], offsets[:, 1]
        distances_m: Floats = np.sqrt(dx * dx + dy * dy)  # rounded as by `near`, which `np.hypot` is not
        return distances_m


class Diagnosis(NamedTuple):
    """One model's finding about one link: whether it cuts the link, a text, and numbers."""

    reason: str
    cuts: bool
    says: str
    numbers: dict[str, Any]


class LinkDraws:
    """Constant random draws of links: equal link and words give an equal draw, whatever the other links.

    Each end has a number from its id and further words; a link's draw follows from both numbers.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._key, self._turn = rng.integers(0, 2**64, 2, dtype=np.uint64) | np.uint64(1)
        self._rng = rng
        self._of_ids: Hashes = np.zeros(0, dtype=np.uint64)
        """Seed of each end's number, by id; grows as needed."""

    @cached_property
    def normals(self) -> Floats:
        """The 65,536 possible standard normal draws."""
        return self._rng.standard_normal(1 << _POOL_BITS)

    def ends(self, ids: Indices, *words: npt.NDArray[np.int64]) -> Hashes:
        """Return a number for each end."""
        try:
            state = self._of_ids[ids]
        except IndexError:
            grown = np.arange(2 * int(ids.max()) + 1, dtype=np.uint64)
            self._of_ids = _mixed(grown * _GOLDEN + self._key)
            state = self._of_ids[ids]
        for word in words:
            state = _mixed(state + word.view(np.uint64) * _GOLDEN)
        return state

    def uniform(self, senders: Hashes, receivers: Hashes, mutual: bool = False) -> Floats:
        """Return a draw from [0, 1) for each link; if mutual, equal in both directions."""
        drawn: Floats = (self._of(senders, receivers, mutual) >> np.uint64(11)).astype(np.float64) * 2.0**-53
        return drawn

    def pick(self, senders: Hashes, receivers: Hashes, mutual: bool = False) -> Indices:
        """Return each link's index into `normals`."""
        return (self._of(senders, receivers, mutual) >> np.uint64(64 - _POOL_BITS)).view(np.intp)

    def _of(self, senders: Hashes, receivers: Hashes, mutual: bool) -> Hashes:
        return _mixed(senders + receivers if mutual else senders + receivers * self._turn)


_POOL_BITS = 16
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)
_FACTORS = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


def _mixed(state: Hashes) -> Hashes:
    """The finaliser of splitmix64: each input bit flips about half of the output bits."""
    state = state ^ (state >> _SHIFTS[0])
    state *= _FACTORS[0]
    state ^= state >> _SHIFTS[1]
    state *= _FACTORS[1]
    state ^= state >> _SHIFTS[2]
    return state
