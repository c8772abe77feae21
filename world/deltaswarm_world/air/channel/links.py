"""What the pieces work on: frames on the air and those who are in reach of them."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import numpy.typing as npt

from deltaswarm_world.density import Floats
from deltaswarm_world.near import Indices

Mask = npt.NDArray[np.bool_]
Hashes = npt.NDArray[np.uint64]


class Ends(NamedTuple):
    """One side of the links: who they are, and where (n, 2) [m; world frame]. Any that have ids, also a base."""

    ids: Indices
    places_m: Floats


class Links:
    """Frames on the air, each with those in reach of it; one row per pair, in order of receiver, then frame.

    Every piece sees all rows, so that its draws do not depend on what the others do.

    Args:
        speakers: who made each frame, one row per frame; by sender, then age.
        listeners: who might hear.
        frames: the frames as encoded; may be left out where nobody asks for sizes.
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
        """Whether the frame is still heard, after the pieces before."""
        self.spare_db: Floats | None = None
        """By how much more power arrives than is needed, if reach is by power."""
        self.rows = rows
        self._speakers, self._listeners, self._frames = speakers, listeners, frames

    @classmethod
    def of_pairs(cls, senders: Ends, receivers: Ends, frames: Sequence[bytes] = ()) -> Self:
        """Each sender with the receiver in the same row."""
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
        """Where each sender is (n, 2) [m]."""
        places_m: Floats = self._speakers.places_m[self.columns]
        return places_m

    @cached_property
    def to_m(self) -> Floats:
        """Where each receiver is (n, 2) [m]."""
        places_m: Floats = self._listeners.places_m[self.rows]
        return places_m

    @property
    def speakers_m(self) -> Floats:
        """Where each row of `speakers` is (n, 2) [m]."""
        return self._speakers.places_m

    @property
    def listeners_m(self) -> Floats:
        """Where each row of `listeners` is (n, 2) [m]."""
        return self._listeners.places_m

    @cached_property
    def sizes(self) -> Floats:
        """Length of each frame as encoded [bytes]."""
        sizes: Floats = np.array([len(frame) for frame in self._frames], dtype=np.float64)[self.columns]
        return sizes

    @cached_property
    def distances_m(self) -> Floats:
        """From sender to receiver [m]."""
        offsets = self.to_m - self.from_m
        dx, dy = offsets[:, 0], offsets[:, 1]
        distances_m: Floats = np.sqrt(dx * dx + dy * dy)  # rounded as by `near`, which `np.hypot` is not
        return distances_m


class Finding(NamedTuple):
    """What one piece says of one link: whether it cuts it, in words, and with its numbers."""

    reason: str
    cuts: bool
    says: str
    numbers: dict[str, Any]


class Piece(Protocol):
    """One model: which links it cuts."""

    @property
    def reason(self) -> str:
        """Under which its cuts are counted."""

    @property
    def holds_for_step(self) -> bool:
        """Whether it closes links for a whole step; the relay asks it, too, so it neither draws nor keeps a state."""

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        """Called once a step, with all links; None is none. This, and nothing else, may draw."""

    def explain(self, links: Links, time_s: float) -> Finding:
        """What it has to say of a single link (the only row), without a draw."""


class LinkDice:
    """Chance that belongs to a link for ever: the same link and words, the same draw, in whatever company.

    Each end gets a number from its id and further words; a link's draw follows from its ends' numbers.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._key, self._turn = rng.integers(0, 2**64, 2, dtype=np.uint64) | np.uint64(1)
        self._rng = rng
        self._of_ids: Hashes = np.zeros(0, dtype=np.uint64)
        """What the number of each end begins with, by its id; grows as needed."""

    @cached_property
    def normals(self) -> Floats:
        """The standard normal draws that there are: 65,536."""
        return self._rng.standard_normal(1 << _POOL_BITS)

    def ends(self, ids: Indices, *words: npt.NDArray[np.int64]) -> Hashes:
        """A number for each end."""
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
        """From 0 to 1, 1 excluded, for each link; if mutual, the same from either end."""
        drawn: Floats = (self._of(senders, receivers, mutual) >> np.uint64(11)).astype(np.float64) * 2.0**-53
        return drawn

    def pick(self, senders: Hashes, receivers: Hashes, mutual: bool = False) -> Indices:
        """Which one of `normals` each link has."""
        return (self._of(senders, receivers, mutual) >> np.uint64(64 - _POOL_BITS)).view(np.intp)

    def _of(self, senders: Hashes, receivers: Hashes, mutual: bool) -> Hashes:
        return _mixed(senders + receivers if mutual else senders + receivers * self._turn)


_POOL_BITS = 16
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)
_FACTORS = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


def _mixed(state: Hashes) -> Hashes:
    """The finaliser of splitmix64: each bit of the input turns half of those of the output."""
    state = state ^ (state >> _SHIFTS[0])
    state *= _FACTORS[0]
    state ^= state >> _SHIFTS[1]
    state *= _FACTORS[1]
    state ^= state >> _SHIFTS[2]
    return state
