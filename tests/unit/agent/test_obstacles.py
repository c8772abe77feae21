"""Obstacles on an agent's map: where ways cross them, free strides, and a walk that reflects."""

import math
import random
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from deltaswarm_agent.controllers.paper.walk import Walk
from deltaswarm_agent.controllers.paper.whereabouts import Whereabouts
from deltaswarm_agent.core.obstacles import ObstacleMap
from deltaswarm_wire.checked import load, plain
from deltaswarm_wire.obstacles import ObstacleSettings
from deltaswarm_wire.settings import AgentSettings
from deltaswarm_world.core.obstacles import Obstacles as WorldObstacles
from tests.support.shapes import SIDE_M, Place, deepest_m, depth_m, places, polygons
from tests.support.tiers import in_one_test

SQUARE = ObstacleSettings(((10.0, 10.0), (20.0, 10.0), (20.0, 20.0), (10.0, 20.0)))
NEAR_M = 1e-4


def on_map(*obstacles: ObstacleSettings, **more: Any) -> AgentSettings:
    table = {"width_m": SIDE_M, "height_m": SIDE_M, "obstacles": [plain(obstacle) for obstacle in obstacles], **more}
    return load(AgentSettings, table)


@in_one_test(
    ("way", "crossing"),
    [
        ((10.0, 0.0), (0.5, (-1.0, 0.0))),
        ((30.0, 0.0), (1 / 6, (-1.0, 0.0))),
        ((4.0, 0.0), None),
        ((-10.0, 0.0), None),
        ((0.0, 20.0), None),
        ((18.0, -20.0), None),
    ],
)
def test_the_first_crossing_is_that_of_the_edge_ahead(way: Place, crossing: tuple[float, Place] | None) -> None:
    """From (5, 15): its share of the way, and the normal that points back; whichever way round the corners go."""
    for obstacle in (SQUARE, ObstacleSettings(SQUARE.corners_m[::-1])):
        found = ObstacleMap(on_map(obstacle)).first_crossing(5.0, 15.0, *way)
        if crossing is None:
            assert found is None
        else:
            assert found is not None
            assert found[0] == pytest.approx(crossing[0])
            assert found[1] == pytest.approx(crossing[1])


def test_who_is_inside_by_mistake_walks_out() -> None:
    """No edge is in the way from within."""
    assert ObstacleMap(on_map(SQUARE)).first_crossing(15.0, 15.0, 10.0, 3.0) is None


@given(polygons(), places, places)
def test_a_way_without_a_crossing_is_free_in_the_world_too(obstacle: ObstacleSettings, a: Place, b: Place) -> None:
    """It does not touch the obstacle, and no body is stopped on it; a way with a crossing is free up to there."""
    assume(depth_m(obstacle, a) < -NEAR_M)
    found = ObstacleMap(on_map(obstacle)).first_crossing(*a, b[0] - a[0], b[1] - a[1])
    if found is None:
        assert deepest_m(obstacle, a, b) < NEAR_M
        assert np.array_equal(WorldObstacles([obstacle]).stop(np.array([a]), np.array([b])), [b])
    else:
        hit = (a[0] + found[0] * (b[0] - a[0]), a[1] + found[0] * (b[1] - a[1]))
        assert deepest_m(obstacle, a, hit) < NEAR_M
        assert abs(depth_m(obstacle, hit)) < NEAR_M


@given(polygons(), places, st.floats(0, math.tau), st.floats(0.05, 3.0), st.integers(0, 200))
def test_free_strides_are_free_one_by_one_and_the_next_is_not(
    obstacle: ObstacleSettings, start: Place, heading: float, stride_m: float, most: int
) -> None:
    """Straight on, as many whole strides as fit before the obstacle or the arena's edge."""
    assume(depth_m(obstacle, start) < -NEAR_M)
    assume(min(start) > NEAR_M and max(start) < SIDE_M - NEAR_M)
    obstacles = ObstacleMap(on_map(obstacle))
    dx, dy = stride_m * math.cos(heading), stride_m * math.sin(heading)
    free = obstacles.free_strides(*start, dx, dy, most)
    assert 0 <= free <= most
    x, y = start
    for _ in range(free):
        assert obstacles.first_crossing(x, y, dx, dy) is None
        x, y = x + dx, y + dy
        assert min(x, y) > 0
        assert max(x, y) < SIDE_M
    assert deepest_m(obstacle, start, (x, y)) < 0
    if free < most:
        x, y = x + 1.001 * dx, y + 1.001 * dy
        leaves = not (0 <= x <= SIDE_M and 0 <= y <= SIDE_M)
        assert leaves or deepest_m(obstacle, start, (x, y), 2000) > -0.02


@given(st.lists(polygons(), min_size=1, max_size=2), places, st.integers(0, 2**32), st.floats(0.1, 6.0))
def test_a_walk_stays_outside_and_within_the_speed_limit(
    obstacles: list[ObstacleSettings], start: Place, seed: int, speed_mps: float
) -> None:
    """Where the world does not have to stop it but for the last micrometres."""
    assume(all(depth_m(obstacle, start) < -NEAR_M for obstacle in obstacles))
    walk = Walk(on_map(*obstacles, speed_mps=speed_mps), 100.0, random.Random(seed))
    world = WorldObstacles(obstacles)
    here = np.array([start])
    promised: tuple[int, tuple[float, float]] = (0, (0.0, 0.0))
    for now in range(60):
        vx_mps, vy_mps = walk.velocity(now, *here[0].tolist())
        assert now >= promised[0] or (vx_mps, vy_mps) == promised[1]
        promised = walk.straight_until(now, *here[0].tolist(), (vx_mps, vy_mps)), (vx_mps, vy_mps)
        assert math.hypot(vx_mps, vy_mps) <= speed_mps * (1 + 1e-9)
        there = here + np.array([vx_mps, vy_mps])
        here = world.stop(here, there)
        assert np.abs(here - there).max() < 1e-2 * speed_mps + 1e-4
        assert not world.inside(here)[0]


def test_an_obstacle_is_a_mirror() -> None:
    """Specular: along the edge a walk goes on as before, across it goes back, at the same speed."""
    walk = Walk(on_map(SQUARE, speed_mps=2.0), 100.0, random.Random(1))
    walk.vx_mps, walk.vy_mps, walk.ends = 1.6, 1.2, 100
    assert walk.velocity(0, 9.0, 14.0) == pytest.approx((0.4, 1.2))
    assert (walk.vx_mps, walk.vy_mps) == pytest.approx((-1.6, 1.2))
    assert walk.velocity(1, 9.4, 15.2) == pytest.approx((-1.6, 1.2))


def test_without_obstacles_a_walk_is_as_it_was() -> None:
    """The same generator gives the same walk, as one whose obstacle is far away."""
    far = ObstacleSettings(((38.0, 38.0), (39.0, 38.0), (38.0, 39.0)))
    one, other = (Walk(on_map(*obstacles), 100.0, random.Random(3)) for obstacles in ((), (far,)))
    walks = [[walk.velocity(now, 20.0, 20.0) for now in range(200)] for walk in (one, other)]
    assert walks[0] == walks[1]


def test_a_place_behind_an_obstacle_cannot_be_gone_to() -> None:
    """Nor one inside; an agent that was sent there would stand at the edge for ever."""
    here = Whereabouts(on_map(SQUARE), 6.0, 4)
    here.move_to((5.0, 15.0), ())
    for place, reachable in (((8.0, 15.0), True), ((15.0, 15.0), False), ((25.0, 15.0), False), ((15.0, 30.0), True)):
        assert here.is_reachable(*place) == reachable
