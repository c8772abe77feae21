"""The engine: what is known of two discs that meet, of a disc at a wall, and of a polygon in parts."""

import math

import numpy as np
import pytest

from deltaswarm_physics.engine import VX, Engine, X, Y, convex_parts
from deltaswarm_wire.obstacles import ObstacleSettings, signed_area_m2
from tests.support.tiers import in_one_test

RADIUS_M = 0.5
ROOM_M = (100.0, 100.0)
LAST = 2.0
"""Time for which engines run [s]."""


def after(*discs: tuple[float, ...], elasticity: float = 0.0, friction: float = 0.0) -> np.ndarray:
    """The states of discs (x, y, vx, vy) [m; m/s] some time later, without any drive."""
    states = np.array([(x, y, 0.0, vx, vy, 0.0) for x, y, vx, vy in discs])
    engine = Engine(states, RADIUS_M, friction, ROOM_M, (), elasticity)
    for _ in range(100):
        engine.step(LAST / 100)
    return engine.states().copy()


def test_equal_discs_that_meet_head_on_swap_their_velocities() -> None:
    """An elastic collision: momentum and energy are kept."""
    states = after((50.0, 50.0, 1.0, 0.0), (52.0, 50.0, -0.5, 0.0), elasticity=1.0)
    assert states[:, VX] == pytest.approx([-0.5, 1.0], abs=1e-9)
    assert states[:, VX + 1] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_inelastic_discs_go_on_together() -> None:
    """With the velocity of their centre of mass: half of the energy of a disc that hits one at rest is lost."""
    states = after((50.0, 50.0, 1.0, 0.0), (52.0, 50.0, 0.0, 0.0))
    assert states[:, VX] == pytest.approx([0.5, 0.5], abs=0.01)
    assert states[:, VX].sum() == pytest.approx(1.0, abs=1e-9)


def test_discs_that_meet_at_an_angle_keep_momentum_and_gain_no_energy() -> None:
    states = after((50.0, 50.0, 1.0, 0.2), (52.0, 50.5, -1.0, 0.0), elasticity=0.5, friction=0.7)
    assert states[:, VX : VX + 2].sum(axis=0) == pytest.approx([0.0, 0.2], abs=1e-9)
    moment = 0.5 * RADIUS_M**2
    energy = 0.5 * (states[:, VX : VX + 2] ** 2).sum() + 0.5 * moment * (states[:, 5] ** 2).sum()
    assert 0.0 < energy < 0.5 * (1.0 + 0.04 + 1.0) - 0.1
    assert np.abs(states[:, 5]).min() > 0.1


def test_a_disc_slides_on_without_drive() -> None:
    [state] = after((50.0, 50.0, 1.0, -2.0))
    assert state[[X, Y]] == pytest.approx([50.0 + LAST, 50.0 - 2 * LAST])


@in_one_test(
    ("start", "axis", "stops_m"),
    [
        ((1.0, 50.0, -3.0, 0.0), X, RADIUS_M),
        ((99.0, 50.0, 3.0, 0.0), X, 100.0 - RADIUS_M),
        ((50.0, 1.0, 0.0, -3.0), Y, RADIUS_M),
        ((50.0, 99.0, 0.0, 3.0), Y, 100.0 - RADIUS_M),
    ],
)
def test_the_arena_s_edge_is_solid(start: tuple[float, ...], axis: int, stops_m: float) -> None:
    [state] = after(start)
    assert state[axis] == pytest.approx(stops_m, abs=0.03)


@in_one_test("turn", [1, -1])
def test_a_concave_obstacle_is_solid_where_it_is_and_open_where_it_is_not(turn: int) -> None:
    """A disc falls into the opening of a U, up to its bottom, and not into its leg."""
    corners = (
        (40.0, 40.0),
        (60.0, 40.0),
        (60.0, 60.0),
        (55.0, 60.0),
        (55.0, 45.0),
        (45.0, 45.0),
        (45.0, 60.0),
        (40.0, 60.0),
    )
    obstacle = ObstacleSettings(corners[::turn])
    states = np.array([(50.0, 61.0, 0.0, 0.0, -4.0, 0.0), (42.5, 62.0, 0.0, 0.0, -4.0, 0.0)])
    engine = Engine(states, RADIUS_M, 0.0, ROOM_M, (obstacle,))
    for _ in range(250):
        engine.step(0.02)
    assert engine.states()[:, Y] == pytest.approx([45.0 + RADIUS_M, 60.0 + RADIUS_M], abs=0.05)
    parts = convex_parts(corners[::turn])
    assert sum(abs(signed_area_m2(part)) for part in parts) == pytest.approx(20.0 * 20.0 - 10.0 * 15.0)


def test_a_star_in_parts_has_the_area_of_the_star() -> None:
    """Five tips of a pentagram: each part is convex, and together they are the whole."""
    star = [
        ((3.0 if i % 2 else 9.0) * math.cos(i * math.pi / 5), (3.0 if i % 2 else 9.0) * math.sin(i * math.pi / 5))
        for i in range(10)
    ]
    whole = 10 * 0.5 * 9.0 * 3.0 * math.sin(math.pi / 5)
    assert sum(abs(signed_area_m2(part)) for part in convex_parts(star)) == pytest.approx(whole)


def test_an_engine_made_from_states_goes_on_as_the_one_they_are_of() -> None:
    """What a checkpoint has is enough, as long as there is no contact."""
    rng = np.random.default_rng(3)
    states = np.column_stack([rng.random((30, 2)) * 80 + 10, rng.normal(size=(30, 4))])
    one = Engine(states, 0.2, 0.7, ROOM_M, ())
    for _ in range(40):
        one.step(0.02)
    assert not one.has_contacts
    other = Engine(one.states(), 0.2, 0.7, ROOM_M, ())
    for _ in range(200):
        one.step(0.02)
        other.step(0.02)
    assert one.states().tolist() == other.states().tolist()
