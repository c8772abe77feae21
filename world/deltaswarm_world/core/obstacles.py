"""Obstacles in the world: positions inside, blocked lines of sight, and where bodies stop."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from deltaswarm_wire.obstacles import ObstacleSettings, signed_area_m2
from deltaswarm_world.core.arrays import Floats, Mask

EDGE_M = 1e-6
"""A body stops at this distance from an edge, so that rounding cannot put it inside."""


class _Polygon(NamedTuple):
    """One obstacle: corners and edge vectors (m, 2) [m], outward unit normals (m, 2), and the box around it."""

    corners_m: Floats
    edges_m: Floats
    normals: Floats
    low_m: Floats
    high_m: Floats


class Obstacles:
    """The obstacles of one arena; places are (n, 2) [m; world frame]."""

    def __init__(self, settings: Sequence[ObstacleSettings]) -> None:
        self._polygons = [_polygon(obstacle) for obstacle in settings]
        self._attenuations_db = [
            np.inf if obstacle.attenuation_db is None else obstacle.attenuation_db for obstacle in settings
        ]

    def __bool__(self) -> bool:
        return bool(self._polygons)

    def inside(self, places_m: Floats) -> Mask:
        inside: Mask = np.zeros(len(places_m), dtype=np.bool_)
        for polygon in self._polygons:
            near = _within(places_m, polygon).nonzero()[0]
            inside[near] |= _inside(places_m[near], polygon)
        return inside

    def attenuations_db(self, from_m: Floats, to_m: Floats) -> Floats:
        """Return the attenuation from each position to the one in the same row; infinite behind a blocking obstacle."""
        losses_db: Floats = np.zeros(len(from_m))
        for polygon, attenuation_db in zip(self._polygons, self._attenuations_db, strict=True):
            losses_db[_crossed(from_m, to_m, polygon)] += attenuation_db
        return losses_db

    def hide(self, from_m: Floats, to_m: Floats) -> Mask:
        """Return which lines of sight meet an obstacle, blocking or not."""
        hidden: Mask = np.zeros(len(from_m), dtype=np.bool_)
        for polygon in self._polygons:
            hidden[_crossed(from_m, to_m, polygon)] = True
        return hidden

    def crossed(self, from_m: Floats, to_m: Floats) -> list[int]:
        return [index for index, polygon in enumerate(self._polygons) if len(_crossed(from_m, to_m, polygon))]

    def stop(self, from_m: Floats, to_m: Floats) -> Floats:
        """Return where bodies that move straight from outside positions end: at the first edge on their path."""
        way_m = to_m - from_m
        shares: Floats = np.ones(len(from_m))
        for polygon in self._polygons:
            rows = _near(from_m, to_m, polygon).nonzero()[0]
            if len(rows):
                shares[rows] = np.minimum(shares[rows], _free_share(from_m[rows], way_m[rows], polygon))
        ends_m: Floats = np.where((shares < 1.0)[:, None], from_m + shares[:, None] * way_m, to_m)
        inside = self.inside(ends_m)
        ends_m[inside] = from_m[inside]
        return ends_m


def _polygon(obstacle: ObstacleSettings) -> _Polygon:
    corners_m = np.array(obstacle.corners_m, dtype=np.float64)
    edges_m = np.roll(corners_m, -1, axis=0) - corners_m
    turn = np.sign(signed_area_m2(obstacle.corners_m))
    normals = turn * np.column_stack([edges_m[:, 1], -edges_m[:, 0]])
    normals /= np.hypot(normals[:, 0], normals[:, 1])[:, None]
    low_m, high_m = corners_m.min(axis=0) - EDGE_M, corners_m.max(axis=0) + EDGE_M
    return _Polygon(corners_m, edges_m, normals, low_m, high_m)


def _within(places_m: Floats, polygon: _Polygon) -> Mask:
    return _both((places_m >= polygon.low_m) & (places_m <= polygon.high_m))


def _near(from_m: Floats, to_m: Floats, polygon: _Polygon) -> Mask:
    """Which lines might meet a polygon, by the boxes around them."""
    low_m, high_m = np.minimum(from_m, to_m), np.maximum(from_m, to_m)
    return _both((low_m <= polygon.high_m) & (high_m >= polygon.low_m))


def _both(mask: Mask) -> Mask:
    """Whether a condition holds along x and along y."""
    both: Mask = mask[..., 0] & mask[..., 1]
    return both


def _inside(places_m: Floats, polygon: _Polygon) -> Mask:
    """By the number of edges to the right of a place."""
    x_m, y_m = places_m[:, 0, None], places_m[:, 1, None]
    ax, ay = polygon.corners_m[:, 0], polygon.corners_m[:, 1]
    ex, ey = polygon.edges_m[:, 0], polygon.edges_m[:, 1]
    spans = (ay > y_m) != (ay + ey > y_m)
    beyond = (x_m - ax) * np.abs(ey) < (y_m - ay) * ex * np.sign(ey)
    odd: Mask = np.count_nonzero(spans & beyond, axis=1) % 2 == 1
    return odd


def _crossed(from_m: Floats, to_m: Floats, polygon: _Polygon) -> npt.NDArray[np.intp]:
    """The rows whose straight line meets an edge, its ends included, or lies within."""
    rows = _near(from_m, to_m, polygon).nonzero()[0]
    p, q = from_m[rows, None, :], to_m[rows, None, :]
    a, b = polygon.corners_m, np.roll(polygon.corners_m, -1, axis=0)
    over = _sides(p, q, a) * _sides(p, q, b) <= 0
    across = _sides(a, b, p) * _sides(a, b, q) <= 0
    meets = (over & across & _overlap(p, q, a, b)).any(axis=1) | _inside(from_m[rows], polygon)
    return rows[meets]


def _sides(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the side of each c from the line a to b: 1 left, -1 right, 0 on it."""
    ux, uy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    sides: Floats = np.sign(ux * (c[..., 1] - a[..., 1]) - uy * (c[..., 0] - a[..., 0]))
    return sides


def _overlap(p: Floats, q: Floats, a: Floats, b: Floats) -> Mask:
    """Whether the boxes around two segments overlap: on one line, the sides alone do not tell."""
    low_m, high_m = np.maximum(np.minimum(p, q), np.minimum(a, b)), np.minimum(np.maximum(p, q), np.maximum(a, b))
    return _both(low_m <= high_m)


def _free_share(from_m: Floats, way_m: Floats, polygon: _Polygon) -> Floats:
    """Return the share of each path before a polygon's edges and the margin in front of them."""
    offsets_m = from_m[:, None, :] - polygon.corners_m
    gaps_m = (offsets_m * polygon.normals).sum(axis=2)
    inwards_m = -(way_m @ polygon.normals.T)
    enters = (inwards_m > 0) & (gaps_m >= -EDGE_M) & (gaps_m < inwards_m + EDGE_M)
    inwards_m = np.where(enters, inwards_m, 1.0)
    hits = np.clip(gaps_m / inwards_m, 0.0, 1.0)
    along_m2 = ((offsets_m + hits[:, :, None] * way_m[:, None, :]) * polygon.edges_m).sum(axis=2)
    lengths_m2 = (polygon.edges_m**2).sum(axis=1)
    slack_m2 = EDGE_M * np.sqrt(lengths_m2)
    enters &= (along_m2 >= -slack_m2) & (along_m2 <= lengths_m2 + slack_m2)
    shares = np.maximum(0.0, (gaps_m - EDGE_M) / inwards_m)
    free: Floats = np.where(enters, shares, 1.0).min(axis=1)
    return free
