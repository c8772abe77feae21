"""Obstacles for tests: polygons of random shape, and another way to tell what is inside."""

import math
from collections.abc import Sequence

from hypothesis import strategies as st

import tests.support.strategies  # noqa: F401 (hypothesis's profile)
from deltaswarm_wire.checked import check
from deltaswarm_wire.obstacles import ObstacleSettings

Place = tuple[float, float]

SIDE_M = 40.0
"""Side of the arena that the polygons are in [m]."""


@st.composite
def polygons(draw: st.DrawFn) -> ObstacleSettings:
    """Star-shaped around a centre, so often with corners that point inwards, clockwise or not."""
    count = draw(st.integers(3, 7))
    x_m, y_m = draw(st.tuples(*[st.floats(8, SIDE_M - 8)] * 2))
    radii_m = draw(st.lists(st.floats(1.0, 8.0), min_size=count, max_size=count))
    turn, clockwise = draw(st.floats(0, math.tau)), draw(st.sampled_from([1, -1]))
    corners = [
        (
            x_m + radius_m * math.cos(turn + clockwise * math.tau * index / count),
            y_m + radius_m * math.sin(turn + clockwise * math.tau * index / count),
        )
        for index, radius_m in enumerate(radii_m)
    ]
    made, problems = check(ObstacleSettings, {"corners_m": [list(corner) for corner in corners]})
    assert made is not None, problems
    return made


coordinates = st.floats(0, SIDE_M)
places = st.tuples(coordinates, coordinates)


def winds_around(obstacle: ObstacleSettings, place: Place) -> bool:
    """Whether a place is inside, by the sum of the angles under which it sees the edges."""
    corners = [(x - place[0], y - place[1]) for x, y in obstacle.corners_m]
    pairs = zip(corners, [*corners[1:], corners[0]], strict=True)
    total = sum(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]) for a, b in pairs)
    return abs(total) > math.pi


def depth_m(obstacle: ObstacleSettings, place: Place) -> float:
    """Distance of a place from the nearest edge; negative outside [m]."""
    corners = obstacle.corners_m
    nearest_m = min(_from_edge_m(place, a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True))
    return nearest_m if winds_around(obstacle, place) else -nearest_m


def deepest_m(obstacle: ObstacleSettings, a: Place, b: Place, points: int = 200) -> float:
    """The greatest depth along a straight line, by samples; negative if it stays outside [m]."""
    shares = (index / points for index in range(points + 1))
    return max(depth_m(obstacle, (a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]))) for s in shares)


def _from_edge_m(place: Place, a: Sequence[float], b: Sequence[float]) -> float:
    ex, ey = b[0] - a[0], b[1] - a[1]
    share = ((place[0] - a[0]) * ex + (place[1] - a[1]) * ey) / (ex * ex + ey * ey)
    share = min(1.0, max(0.0, share))
    return math.hypot(place[0] - a[0] - share * ex, place[1] - a[1] - share * ey)
