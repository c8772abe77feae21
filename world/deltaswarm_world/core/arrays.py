"""Types of arrays, the search for neighbours, and the random generators of a run.

Each random model has a generator of its own, so that one does not change the draws of another.
"""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from deltaswarm_wire.seeds import derived_key

Floats: TypeAlias = npt.NDArray[np.float64]
Mask: TypeAlias = npt.NDArray[np.bool_]
Indices: TypeAlias = npt.NDArray[np.intp]

FEW_PAIRS = 10_000
"""Up to this number a full comparison is faster than a search by strips."""


def near(places_m: Floats, others_m: Floats, range_m: float) -> tuple[Indices, Indices]:
    """Which of `others_m` (m, 2) are within the range, itself included, of which of `places_m` (n, 2).

    Two arrays of indices, into `places_m` and into `others_m`, in order of the first and then the second.
    """
    first, second, _ = near_with_squares(places_m, others_m, range_m)
    return first, second


def near_with_squares(places_m: Floats, others_m: Floats, range_m: float) -> tuple[Indices, Indices, Floats]:
    """Return the same with the square of each pair's distance [m2]."""
    if len(places_m) * len(others_m) <= FEW_PAIRS:
        # By coordinate: numpy is several times slower along an axis of length 2.
        squares_m2 = _squares_m2(places_m[:, 0, None] - others_m[:, 0], places_m[:, 1, None] - others_m[:, 1])
        pairs = (squares_m2.ravel() <= range_m**2).nonzero()[0]
        first, second = np.divmod(pairs, len(others_m))
        return first, second, squares_m2.ravel()[pairs]
    first, second = _candidates(places_m, others_m, range_m)
    first, second = np.divmod(np.sort(first * np.intp(len(others_m)) + second), len(others_m))
    offsets_m = places_m[first] - others_m[second]
    squares_m2 = _squares_m2(offsets_m[:, 0], offsets_m[:, 1])
    within = squares_m2 <= range_m**2
    return first[within], second[within], squares_m2[within]


def _squares_m2(dx_m: Floats, dy_m: Floats) -> Floats:
    squares_m2: Floats = dx_m * dx_m + dy_m * dy_m
    return squares_m2


def _candidates(places_m: Floats, others_m: Floats, range_m: float) -> tuple[Indices, Indices]:
    """Return all pairs within the range in each coordinate, and some slightly beyond, since sums round differently.

    At most the others in a place's strip of the arena are compared with it: those within the range in x.
    """
    reach_m = range_m * 1.000001
    by_x = others_m[:, 0].argsort()
    x_m = others_m[by_x, 0]
    begins = x_m.searchsorted(places_m[:, 0] - reach_m)
    counts = x_m.searchsorted(places_m[:, 0] + reach_m, side="right") - begins
    first = np.arange(len(places_m)).repeat(counts)
    skipped = counts.cumsum() - counts
    second = by_x[np.arange(len(first)) + (begins - skipped).repeat(counts)]
    beside = np.abs(places_m[first, 1] - others_m[second, 1]) <= reach_m
    return first[beside], second[beside]


def checked_rows(value: object, count: int, what: str, low: Floats | float, high: Floats | float) -> Floats:
    """Return a plug-in's array (count, 2) as floats."""
    if not isinstance(value, np.ndarray) or value.shape != (count, 2) or value.dtype.kind not in "fiu":
        raise ValueError(f"must {what}, an array of numbers of shape ({count}, 2) (got {_kind(value)})")
    rows: Floats = value.astype(np.float64, copy=False)
    is_well = (rows >= low) & (rows <= high)  # false for NaN, too
    if not is_well.all():
        row = int(is_well.all(axis=1).argmin())
        raise ValueError(f"must {what}, finite and in range (got {rows[row].tolist()} for agent {row})")
    return rows


def checked_mask(value: object, count: int, what: str) -> Mask:
    """Return a plug-in's mask, an array (count,) of bool. Raises ValueError if it is none."""
    if not isinstance(value, np.ndarray) or value.shape != (count,) or value.dtype != np.bool_:
        raise ValueError(f"must return a mask of {what}, an array of bool of shape ({count},) (got {_kind(value)})")
    return value


def checked_truth(_: object, value: object, *arguments: object) -> bool:
    """Return whether a plug-in says yes. Raises ValueError if it says neither."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"must be True or False (got {value!r:.80})")
    return bool(value)


def checked_agents(value: object, count: int) -> frozenset[int]:
    """Return a plug-in's set of agents. Raises ValueError if it is none."""
    if not isinstance(value, set | frozenset) or any(type(agent) is not int for agent in value):
        raise ValueError(f"must give a set of agents' numbers (got {value!r:.80})")
    if strangers := [agent for agent in value if not 0 <= agent < count]:
        raise ValueError(f"must give a set of agents from 0 to {count - 1} (got {strangers[0]})")
    return frozenset(value)


def _kind(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    return "None" if value is None else type(value).__name__


def generator(seed: int, *stream: int) -> np.random.Generator:
    """Make the generator of one stream of a run, which an agent cannot derive from its own seed."""
    return np.random.default_rng([int.from_bytes(derived_key(seed, "world"), "little"), *stream])
