"""The physics engine of a run: discs and walls in a space of Chipmunk, driven by forces alone.

Chipmunk keeps impulses of contacts from step to step, and its tree of boxes an order of pairs. Neither can be read into
a checkpoint. So an engine with contacts is made again before the next step of the world, and a spatial hash, which has
no past, finds the pairs. Overwritten velocities would let discs overlap and pass walls.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pymunk
from pymunk import batch
from pymunk.autogeometry import convex_decomposition
from pymunk.batch import ArbiterFields, BodyFields

from deltaswarm_wire.obstacles import ObstacleSettings, signed_area_m2
from deltaswarm_world.core.arrays import Floats

SLOP_OF_RADIUS = 0.02
"""Overlap that the engine tolerates, as a share of the radius."""
ITERATIONS = 10
LEFT_PER_S = 0.7**60
"""Share of an overlap beyond the slop that is left after a second."""
MASS_KG = 1.0
MOMENT_OF_RADIUS = 0.5 * MASS_KG
"""Moment of inertia of a disc over its squared radius [kg]."""

STATE = BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
DRIVE = BodyFields.FORCE | BodyFields.TORQUE
X, Y, ANGLE, VX, VY, TURN = range(6)
"""Columns of a state: position [m], angle [rad], velocity [m/s], turning rate [rad/s]."""


class Engine:
    """Discs of one radius between walls, larger by the slop, so that bodies touch before they overlap.

    `states` (n, 6) are as the columns say; they are all that a step depends on.
    """

    def __init__(
        self,
        states: Floats,
        radius_m: float,
        friction: float,
        size_m: tuple[float, float],
        obstacles: Sequence[ObstacleSettings],
        elasticity: float = 0.0,
    ) -> None:
        self._space = space = pymunk.Space()
        space.iterations = ITERATIONS
        space.collision_slop = slop_m = SLOP_OF_RADIUS * radius_m
        space.collision_bias = LEFT_PER_S
        space.collision_persistence = 1  # with 0 nothing collides
        space.use_spatial_hash(max(4.0 * radius_m, 2.0), 10 * len(states) + 100)
        for wall in _walls(space.static_body, size_m, obstacles, radius_m):
            wall.friction, wall.elasticity = friction, elasticity
            space.add(wall)
        for x, y, angle, vx, vy, turn in states.tolist():
            body = pymunk.Body(MASS_KG, MOMENT_OF_RADIUS * radius_m**2)
            body.position, body.angle = (x, y), angle
            body.velocity, body.angular_velocity = (vx, vy), turn
            disc = pymunk.Circle(body, radius_m + slop_m)
            disc.friction, disc.elasticity = friction, elasticity
            space.add(body, disc)
        self._count = len(states)
        self._got, self._contacts = batch.Buffer(), batch.Buffer()
        drives: Floats = np.zeros((len(states) + 1, 3))  # the last body is the walls'
        self.drives = drives[:-1]
        """Force along x and y [N; world frame] and torque [N m] on each disc, in each step of the engine."""
        self._set = batch.Buffer()
        self._set.set_float_buf(drives)

    def states(self) -> Floats:
        self._got.clear()
        batch.get_space_bodies(self._space, STATE, self._got)
        states: Floats = np.frombuffer(self._got.float_buf(), dtype=np.float64).reshape(-1, 6)
        return states[: self._count]

    def step(self, step_s: float) -> None:
        """Move by a step of the engine [s], driven by `drives`."""
        batch.set_space_bodies(self._space, DRIVE, self._set)
        self._space.step(step_s)

    @property
    def has_contacts(self) -> bool:
        """Whether the engine remembers a contact."""
        self._contacts.clear()
        batch.get_space_arbiters(self._space, ArbiterFields.CONTACT_COUNT, self._contacts)
        return len(self._contacts.int_buf()) > 0


def _walls(
    body: Any, size_m: tuple[float, float], obstacles: Sequence[ObstacleSettings], radius_m: float
) -> list[pymunk.Shape]:
    """Make the solid parts of an arena: slabs around it, a diameter thick, and its obstacles in convex parts."""
    (width_m, height_m), out_m = size_m, radius_m
    low, right, top = -out_m, width_m + out_m, height_m + out_m
    corners = [(low, low), (right, low), (right, top), (low, top)]
    walls: list[pymunk.Shape] = [
        pymunk.Segment(body, a, b, out_m) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    for obstacle in obstacles:
        walls += [pymunk.Poly(body, part) for part in convex_parts(obstacle.corners_m)]
    return walls


def convex_parts(corners: Sequence[Sequence[float]]) -> list[list[tuple[float, float]]]:
    """Split a polygon into convex parts."""
    loop = [(x, y) for x, y in corners]
    if signed_area_m2(loop) < 0:
        loop.reverse()
    parts = [[(x, y) for x, y in part] for part in convex_decomposition([*loop, loop[0]], 0.0)]
    return [part[:-1] if part[0] == part[-1] else part for part in parts]
