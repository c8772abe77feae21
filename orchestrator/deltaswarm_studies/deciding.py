"""Say why a question is open, and how many runs would decide it.

The number follows from the interval by a normal approximation: its half width is a quantile times the standard error,
which falls with the root of the number of runs. With so many runs the test decides with a probability of `POWER` if
what was found is the truth.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Literal

import pandas as pd
from scipy.stats import norm

from deltaswarm_studies.stats import RATIO, Interval, Scale, pairs_needed
from deltaswarm_studies.welch import MAX_REPLICATES, POWER

Open = Literal["too few runs", "too few cells", "too few halves", "no margin", "cannot be closed", ""]
"""Why something is not decided; empty if it is.

Too few cells: of a mean over the levels of a factor. Too few halves: of a comparison in half of the replicates. No
margin: runs can show a difference and never that there is none. Cannot be closed: nor is a difference in sight, the
published number is too uncertain, or values are at their ceiling.
"""
UNDECIDED = ("unclear", "undecided")

WITHIN = (1 + POWER) / 2
"""The power that each of two one-sided tests needs so that both together have `POWER`."""

Distance = tuple[float, float]
"""How far what was found is from where the verdict changes, and the power with which that is to be shown."""


def from_edges(found: float, edges: Sequence[float]) -> list[Distance]:
    """Return the distance to the nearest of one or two edges of a region."""
    is_inside = len(edges) > 1 and min(edges) < found < max(edges)
    return [(min(abs(found - edge) for edge in edges), WITHIN if is_inside else POWER)] if edges else []


def runs_needed(interval: Interval, n: int, alpha: float, distances: Iterable[Distance]) -> int | None:
    """Return how many runs would decide, by the easiest of several ways; None if more than `MAX_REPLICATES`."""
    quantile = float(norm.isf(alpha / 2))
    error = (interval[1] - interval[0]) / (2 * quantile)
    needed = [
        n * (error * (quantile + float(norm.ppf(power))) / distance) ** 2
        for distance, power in distances
        if distance > 0
    ]
    least = min(needed, default=math.inf)
    return math.ceil(least) if least <= MAX_REPLICATES else None


def open_contrast(
    estimate: float, interval: Interval, n: int, alpha: float, scale: Scale, margin: float, family: int
) -> tuple[Open, int | None]:
    """Return why a contrast is open, and the runs that would decide it; `margin` is 0 where there is none.

    A `family` of 0 is that of a mean, for whose test no number of pairs is too small but one.
    """
    if n < pairs_needed(family) if family else not all(map(math.isfinite, interval)):
        return "too few runs", pairs_needed(max(family, 1))
    if scale == RATIO:
        estimate, interval = math.log(estimate), (math.log(interval[0]), math.log(interval[1]))
    distances = [(abs(estimate), POWER)]
    if margin:
        distances.append((math.log(margin) - abs(estimate) if scale == RATIO else 0.0, WITHIN))
    needed = runs_needed(interval, n, alpha, distances)
    return "too few runs" if margin else "no margin" if needed else "cannot be closed", needed


def with_reopened(rows: pd.DataFrame) -> pd.DataFrame:
    """Mark what the ceiling of its values has undone: it is undecided, and the tests had decided it."""
    is_undone = rows["verdict"].isin(UNDECIDED) & (rows["open"] == "")
    return rows.assign(open=rows["open"].where(~is_undone, "cannot be closed"))
