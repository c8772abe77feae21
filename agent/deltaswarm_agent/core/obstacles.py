"""Obstacles on an agent's map: crossings of straight paths, and reflections of a walk. Positions in m."""

import math
from typing import NamedTuple

from deltaswarm_wire.obstacles import signed_area_m2
from deltaswarm_wire.settings import AgentSettings

EDGE_M = 1e-5
"""A position this close to an edge counts as on it. The world stops bodies closer to the edge, so a path that is free
for an agent is free in the world."""

Crossing = tuple[float, tuple[float, float]]
"""The share of a straight path before it enters an obstacle, and the edge's outward unit normal there."""


class _Edge(NamedTuple):
    """One edge of an obstacle: from a corner along (ex, ey), with outward unit normal (nx, ny)."""

    x_m: float
    y_m: float
    ex_m: float
    ey_m: float
    nx: float
    ny: float


class Stride(NamedTuple):
    """The end of a stride, and the next stride of the same leg."""

    to_x_m: float
    to_y_m: float
    dx_m: float
    dy_m: float


class ObstacleMap:
    """The obstacles of an agent's map, and the edge of the arena around them.

    For a body, edges stand out by its radius, and are longer by it at both ends.
    """

    def __init__(self, settings: AgentSettings) -> None:
        self._radius_m = radius_m = settings.radius_m
        self._size_m = (settings.width_m, settings.height_m)
        self._edges: list[_Edge] = []
        for obstacle in settings.obstacles:
            corners = obstacle.corners_m
            turn = math.copysign(1.0, signed_area_m2(corners))
            for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
                ex, ey = bx - ax, by - ay
                length = math.hypot(ex, ey)
                nx, ny = turn * ey / length, -turn * ex / length
                if radius_m:
                    ax, ay = ax + radius_m * (nx - ex / length), ay + radius_m * (ny - ey / length)
                    ex, ey = ex * (1.0 + 2.0 * radius_m / length), ey * (1.0 + 2.0 * radius_m / length)
                self._edges.append(_Edge(ax, ay, ex, ey, nx, ny))

    def __bool__(self) -> bool:
        return bool(self._edges)

    def first_crossing(self, x_m: float, y_m: float, dx_m: float, dy_m: float) -> Crossing | None:
        """Find where the straight path from a position by (dx_m, dy_m) first enters an obstacle.

        Leaving an obstacle is no crossing: an agent that is inside by mistake can walk out.
        """
        first: Crossing | None = None
        for edge in self._edges:
            inwards = -(dx_m * edge.nx + dy_m * edge.ny)
            gap_m = (x_m - edge.x_m) * edge.nx + (y_m - edge.y_m) * edge.ny
            if inwards <= 0.0 or gap_m < -EDGE_M or gap_m > inwards + EDGE_M:
                continue
            share = min(max(0.0, gap_m / inwards), 1.0)
            if first is not None and share >= first[0]:
                continue
            hit_x, hit_y = x_m + share * dx_m - edge.x_m, y_m + share * dy_m - edge.y_m
            length_m2 = edge.ex_m * edge.ex_m + edge.ey_m * edge.ey_m
            slack = EDGE_M * math.sqrt(length_m2)
            if -slack <= hit_x * edge.ex_m + hit_y * edge.ey_m <= length_m2 + slack:
                first = share, (edge.nx, edge.ny)
        return first

    def free_strides(self, x_m: float, y_m: float, dx_m: float, dy_m: float, most: int) -> int:
        """Count the strides of (dx_m, dy_m) before an obstacle or the arena's edge, up to `most`.

        None of these strides has a crossing, so a walk need not check them individually.
        """
        free = float(most)
        for at_m, stride_m, end_m in ((x_m, dx_m, self._size_m[0]), (y_m, dy_m, self._size_m[1])):
            if stride_m:
                room_m = (end_m - at_m if stride_m > 0 else at_m) - self._radius_m - EDGE_M
                free = max(0.0, min(free, room_m / abs(stride_m)))
        for edge in self._edges:
            free *= _share_before(edge, x_m, y_m, free * dx_m, free * dy_m)
        return math.floor(free)

    def reflect(self, x_m: float, y_m: float, stride: Stride) -> Stride | None:
        """Mirror a stride at the obstacle that it meets, or cut it at the edge if there is no room.

        Returns None if it meets no obstacle.
        """
        way_x, way_y = stride.to_x_m - x_m, stride.to_y_m - y_m
        crossing = self.first_crossing(x_m, y_m, way_x, way_y)
        if crossing is None:
            return None
        share, (nx, ny) = crossing
        dx_m, dy_m = _mirrored(stride.dx_m, stride.dy_m, nx, ny)
        rest_x, rest_y = _mirrored((1.0 - share) * way_x, (1.0 - share) * way_y, nx, ny)
        back_x, back_y = share * way_x + rest_x, share * way_y + rest_y
        to_x, to_y = x_m + back_x, y_m + back_y
        least_m = self._radius_m
        is_inside = least_m <= to_x <= self._size_m[0] - least_m and least_m <= to_y <= self._size_m[1] - least_m
        if is_inside and self.first_crossing(x_m, y_m, back_x, back_y) is None:
            return Stride(to_x, to_y, dx_m, dy_m)
        return Stride(x_m + share * way_x, y_m + share * way_y, dx_m, dy_m)


def _share_before(edge: _Edge, x_m: float, y_m: float, dx_m: float, dy_m: float) -> float:
    """The share of a straight path before it comes near an edge from outside; 1 if it does not.

    Near means 2 `EDGE_M`: twice the tolerance of a crossing.
    """
    inwards = -(dx_m * edge.nx + dy_m * edge.ny)
    gap_m = (x_m - edge.x_m) * edge.nx + (y_m - edge.y_m) * edge.ny
    if inwards <= 0.0 or gap_m < -2.0 * EDGE_M or gap_m > inwards + 2.0 * EDGE_M:
        return 1.0
    begins, ends = max(0.0, (gap_m - 2.0 * EDGE_M) / inwards), min(1.0, (gap_m + 2.0 * EDGE_M) / inwards)
    length_m2 = edge.ex_m * edge.ex_m + edge.ey_m * edge.ey_m
    slack = 2.0 * EDGE_M * math.sqrt(length_m2)
    along = [
        (x_m + share * dx_m - edge.x_m) * edge.ex_m + (y_m + share * dy_m - edge.y_m) * edge.ey_m
        for share in (begins, ends)
    ]
    return begins if max(along) >= -slack and min(along) <= length_m2 + slack else 1.0


def _mirrored(dx: float, dy: float, nx: float, ny: float) -> tuple[float, float]:
    """Mirror a vector that points into an edge."""
    into = min(0.0, dx * nx + dy * ny)
    return dx - 2.0 * into * nx, dy - 2.0 * into * ny
