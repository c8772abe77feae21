"""Posts: places at which agents wait for events, by k-median of the places where events occur."""

from random import Random

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

REACH_SHARE = 0.8
"""A post serves an event within this share of the sensing range at once."""

FAR_M = 30.0
"""A place farther than this from every post counts as this far when the first posts are chosen."""

CANDIDATES, ROUNDS = 60, 8
"""Number of places tried for each post, and of rounds in which all posts are moved."""

SERVED_WEIGHT = 0.05
"""Weight of a place that its post serves at once, when the post is moved."""

SOFTENING_M = 0.5
"""Keeps the weights of Weiszfeld's algorithm finite."""


def posts(places_m: Floats, count: int, sensing_range_m: float, rng: Random) -> Floats:
    """Return at most `count` posts (n, 2) for places (m, 2) [m]: the distances from posts to places are short.

    The first posts are chosen greedily from random places (k-median); then each moves towards the median of its places
    (Weiszfeld's algorithm).
    """
    reach_m = REACH_SHARE * sensing_range_m
    chosen: list[Floats] = []
    way_m = np.full(len(places_m), FAR_M)
    for _ in range(count):
        tried = [rng.randrange(len(places_m)) for _ in range(min(CANDIDATES, len(places_m)))]
        ways_m = np.minimum(_ways_m(places_m, places_m[tried], reach_m), way_m[:, None])
        best = int(ways_m.sum(axis=0).argmin())
        way_m = ways_m[:, best]
        chosen.append(places_m[tried[best]])
    found_m: Floats = np.array(chosen).reshape(-1, 2)
    for _ in range(ROUNDS if chosen else 0):
        away_m = np.hypot(*(places_m[:, None] - found_m).transpose(2, 0, 1))
        nearest = away_m.argmin(axis=1)
        nearest_m = away_m[np.arange(len(places_m)), nearest]
        weights = np.where(nearest_m > reach_m, 1.0, SERVED_WEIGHT) / (nearest_m + SOFTENING_M)
        for post in range(len(found_m)):
            mine = nearest == post
            if mine.any():
                found_m[post] = np.average(places_m[mine], axis=0, weights=weights[mine])
    return found_m


def _ways_m(places_m: Floats, from_m: Floats, reach_m: float) -> Floats:
    """Return how far one must go from each of the positions until each place is within reach [m]."""
    away_m: Floats = np.hypot(*(places_m[:, None] - from_m).transpose(2, 0, 1))
    return np.maximum(away_m - reach_m, 0.0)
