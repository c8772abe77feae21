"""Who is near whom."""

import numpy as np
import numpy.typing as npt

from deltaswarm_world.density import Floats

Indices = npt.NDArray[np.intp]

FEW_PAIRS = 10_000
"""Up to so many it is quicker to look at each than to sort them by place first."""


def near(places_m: Floats, others_m: Floats, range_m: float) -> tuple[Indices, Indices]:
    """Which of `others_m` (m, 2) are within the range, itself included, of which of `places_m` (n, 2).

    Two arrays of indices, into `places_m` and into `others_m`, in order of the first and then the second.
    """
    if len(places_m) * len(others_m) <= FEW_PAIRS:
        # Coordinate by coordinate: along an axis of two numpy is several times slower.
        dx = places_m[:, 0, None] - others_m[:, 0]
        dy = places_m[:, 1, None] - others_m[:, 1]
        first, second = (dx * dx + dy * dy <= range_m**2).nonzero()
        return first, second
    first, second = _candidates(places_m, others_m, range_m)
    offsets = places_m[first] - others_m[second]
    within = offsets[:, 0] * offsets[:, 0] + offsets[:, 1] * offsets[:, 1] <= range_m**2
    first, second = first[within], second[within]
    order = np.lexsort((second, first))
    return first[order], second[order]


def _candidates(places_m: Floats, others_m: Floats, range_m: float) -> tuple[Indices, Indices]:
    """All pairs within the range, and some a trifle beyond: a tree rounds differently."""
    from scipy.spatial import KDTree  # slow to import, and small swarms do without

    found = KDTree(places_m).sparse_distance_matrix(KDTree(others_m), range_m * 1.000001, output_type="ndarray")
    return found["i"], found["j"]
