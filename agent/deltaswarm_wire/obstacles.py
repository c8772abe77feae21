"""Obstacles: polygons in the arena that block motion and sensing and attenuate radio."""

from collections.abc import Sequence
from dataclasses import dataclass

from deltaswarm_wire.checked import Problem, key, plain_value

Place = tuple[float, ...]

LEAST_AREA_M2 = 1e-6


@dataclass(frozen=True)
class ObstacleSettings:
    """One obstacle. Corners go clockwise or counterclockwise; edges must not cross."""

    corners_m: tuple[Place, ...] = key((), "at least 3 corners [m], in order along the edge", length=None)
    attenuation_db: float | None = key(
        None,
        "attenuation of a frame whose line of sight crosses the obstacle [dB]; default: the frame is lost",
        low=0,
        high=1000,
    )

    def problems(self) -> list[Problem]:
        """The corners must make a polygon."""
        corners = self.corners_m
        if problems := coordinate_problems("corners_m", corners):
            return problems
        if len(corners) < 3:
            return [Problem("corners_m", f"{len(corners)}", "must be at least 3 corners")]
        area_m2 = abs(signed_area_m2(corners))
        if area_m2 < LEAST_AREA_M2:
            allowed = "must enclose an area"
            return [Problem("corners_m", f"{area_m2:.15g} m2", allowed)]
        if crossing := _crossing_edges(corners):
            first, second = crossing
            allowed = "must be in order along the edge"
            return [Problem("corners_m", f"edges that meet after corners {first} and {second}", allowed)]
        return []


def coordinate_problems(name: str, places: Sequence[Place]) -> list[Problem]:
    """Check that each of a key's places has two coordinates."""
    return [
        Problem(f"{name}[{index}]", str(plain_value(place))[:60], "must be two coordinates [x, y]")
        for index, place in enumerate(places)
        if len(place) != 2
    ]


def signed_area_m2(corners: Sequence[Place]) -> float:
    """Area of a polygon; positive if its corners go counterclockwise [m2]."""
    x0, y0 = corners[0]
    return 0.5 * sum(
        (ax - x0) * (by - y0) - (bx - x0) * (ay - y0)
        for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True)
    )


def is_inside(place: Sequence[float], corners: Sequence[Place]) -> bool:
    """Whether a position is inside a polygon: a line from it to the right crosses an odd number of edges."""
    x, y = place
    odd = False
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            odd = not odd
    return odd


def edge_distance_m2(place: Sequence[float], a: Sequence[float], b: Sequence[float]) -> float:
    """Return the squared distance of a position from the edge from a to b [m2]."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length_m2 = dx * dx + dy * dy
    share = 0.0 if length_m2 == 0 else ((place[0] - a[0]) * dx + (place[1] - a[1]) * dy) / length_m2
    share = max(0.0, min(1.0, share))
    return (a[0] + share * dx - place[0]) ** 2 + (a[1] + share * dy - place[1]) ** 2


def obstacle_problems(obstacles: Sequence[ObstacleSettings], size_m: tuple[float, float]) -> list[Problem]:
    """Check obstacles against the arena: corners must be within it."""
    allowed = f"must be within the arena, {size_m[0]:.15g} m x {size_m[1]:.15g} m"
    return [
        Problem(f"arena.obstacles[{index}].corners_m[{number}]", str(plain_value(corner)), allowed)
        for index, obstacle in enumerate(obstacles)
        for number, corner in enumerate(obstacle.corners_m)
        if not all(0.0 <= x <= end for x, end in zip(corner, size_m, strict=True))
    ]


def _crossing_edges(corners: Sequence[Place]) -> tuple[int, int] | None:
    """Find two edges, by their first corners, that meet outside a shared corner."""
    count = len(corners)
    edges = [(corners[index], corners[(index + 1) % count]) for index in range(count)]
    for first in range(count):
        for second in range(first + 1, count):
            (a, b), (c, d) = edges[first], edges[second]
            is_next = second == first + 1 or (first == 0 and second == count - 1)
            meet = _folds_back(edges, first, second) if is_next else _meet(a, b, c, d)
            if a == b or c == d or meet:
                return first, second
    return None


def _side(a: Place, b: Place, c: Place) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _meet(a: Place, b: Place, c: Place, d: Place) -> bool:
    """Whether two segments share a point."""
    if not (_overlap(a[0], b[0], c[0], d[0]) and _overlap(a[1], b[1], c[1], d[1])):
        return False
    return _side(a, b, c) * _side(a, b, d) <= 0 and _side(c, d, a) * _side(c, d, b) <= 0


def _overlap(a: float, b: float, c: float, d: float) -> bool:
    return max(min(a, b), min(c, d)) <= min(max(a, b), max(c, d))


def _folds_back(edges: Sequence[tuple[Place, Place]], first: int, second: int) -> bool:
    """Whether two edges that share a corner lie on top of each other."""
    (a, b), (c, d) = edges[first], edges[second]
    shared, one, other = (b, a, d) if b == c else (a, b, c)
    along = (one[0] - shared[0]) * (other[0] - shared[0]) + (one[1] - shared[1]) * (other[1] - shared[1])
    return _side(one, shared, other) == 0 and along > 0
