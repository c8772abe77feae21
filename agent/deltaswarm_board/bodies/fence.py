"""The geofence: a polygon that no commanded velocity may leave. Positions in m, arena frame."""

from collections.abc import Sequence
from itertools import combinations

from deltaswarm_wire.obstacles import edge_distance_m2, is_inside

Place = tuple[float, float]
Edge = tuple[Place, Place]

TOUCH_M = 0.001
"""Edges closer than this touch [m]."""


class Fence:
    """A simple polygon, its corners in order."""

    def __init__(self, corners: Sequence[Place]) -> None:
        if len(corners) < 3:
            raise ValueError(f"must have at least 3 corners, not {len(corners)}")
        self._corners = corners
        self._edges = list(zip(corners, [*corners[1:], corners[0]], strict=True))
        for index, corner in enumerate(corners):
            if corner in corners[:index]:
                raise ValueError(
                    f"must have each corner once, unlike {_shown(corner)}; the last is joined to the first"
                )
        for one, other in combinations(self._edges, 2):
            if _meet(one, other):
                edges = " and ".join(f"{_shown(a)}-{_shown(b)}" for a, b in (one, other))
                raise ValueError(f"must have edges that meet only at corners, unlike {edges}")

    def holds(self, at: Place) -> bool:
        return is_inside(at, self._corners)

    def permits(self, at: Place, vx_mps: float, vy_mps: float, ahead_s: float) -> bool:
        """Whether a vehicle at this position may take this velocity, looking `ahead_s` [s] ahead.

        Inside, the whole path must stay inside. Outside, the vehicle may only stand or approach the fence.
        """
        to = (at[0] + vx_mps * ahead_s, at[1] + vy_mps * ahead_s)
        if self.holds(at):
            return self.holds(to) and not any(_cross(at, to, a, b) for a, b in self._edges)
        return (vx_mps, vy_mps) == (0.0, 0.0) or self.holds(to) or self._distance_m2(to) < self._distance_m2(at)

    def _distance_m2(self, at: Place) -> float:
        """Squared distance to the nearest edge [m2]."""
        return min(edge_distance_m2(at, a, b) for a, b in self._edges)


def _shown(at: Place) -> str:
    return f"({at[0]:g}, {at[1]:g})"


def _meet(one: Edge, other: Edge) -> bool:
    """Whether two edges cross or touch outside a shared corner."""
    ends = [(end, edge) for edge, ends in ((one, other), (other, one)) for end in ends if end not in edge]
    return _cross(*one, *other) or any(edge_distance_m2(end, *edge) < TOUCH_M**2 for end, edge in ends)


def _cross(a: Place, b: Place, c: Place, d: Place) -> bool:
    """Whether two segments cross, with each one's ends on opposite sides of the other."""
    return _side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0


def _side(a: Place, b: Place, c: Place) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
