"""Motion: the random walk within its walls, and the way to a place."""

import math
import random
from collections.abc import Iterator
from dataclasses import replace
from itertools import count, pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_agent.controller import STAND, Velocity
from deltaswarm_agent.controllers.paper.walk import Walk, leg_s, towards
from deltaswarm_wire.checked import load
from deltaswarm_wire.messages import MAX_POSES
from deltaswarm_wire.obstacles import ObstacleSettings
from deltaswarm_wire.settings import AgentSettings
from tests.support.shapes import SIDE_M, Place, places, polygons
from tests.support.tiers import in_one_test

ENDLESS_S = 1e9
sizes_m = st.floats(3.0, 60.0)
shares = st.floats(0.0, 1.0)
speeds_mps = st.floats(0.01, 20.0)
steps_s = st.floats(0.01, 5.0)
seeds = st.integers(0, 2**32)


LEG_MAX_S = 100.0


def an_agent(**keys: Any) -> AgentSettings:
    return load(AgentSettings, keys)


def walk(
    settings: AgentSettings, seed: int, x_m: float, y_m: float, steps: int, leg_max_s: float = LEG_MAX_S
) -> Iterator[tuple[float, float]]:
    legs = Walk(settings, leg_max_s, random.Random(seed))
    for now in range(steps):
        yield x_m, y_m
        vx_mps, vy_mps = legs.velocity(now, x_m, y_m)
        x_m, y_m = x_m + vx_mps * settings.step_s, y_m + vy_mps * settings.step_s
    yield x_m, y_m


def folded(unbounded_m: float, wall_m: float) -> float:
    """Where a mirror at 0 and at the wall shows a place that lies beyond them."""
    return wall_m - abs(unbounded_m % (2 * wall_m) - wall_m)


@given(sizes_m, sizes_m, shares, shares, speeds_mps, steps_s, seeds)
def test_a_walk_stays_in_the_arena(
    width_m: float, height_m: float, right: float, up: float, speed_mps: float, step_s: float, seed: int
) -> None:
    settings = an_agent(width_m=width_m, height_m=height_m, speed_mps=speed_mps, step_s=step_s)
    for x_m, y_m in walk(settings, seed, right * width_m, up * height_m, 80):
        assert -1e-9 <= x_m <= width_m + 1e-9
        assert -1e-9 <= y_m <= height_m + 1e-9


@given(sizes_m, sizes_m, st.floats(0.35, 0.65), seeds)
def test_walls_are_mirrors(width_m: float, height_m: float, share: float, seed: int) -> None:
    """Specular reflection: a leg is a straight line folded at the walls, so each speed component is kept."""
    settings = an_agent(width_m=width_m, height_m=height_m)
    places = list(walk(settings, seed, share * width_m, share * height_m, 200, ENDLESS_S))
    (x_m, y_m), (next_x_m, next_y_m) = places[:2]
    for step, place in enumerate(places):
        assert place[0] == pytest.approx(folded(x_m + step * (next_x_m - x_m), width_m), abs=1e-6)
        assert place[1] == pytest.approx(folded(y_m + step * (next_y_m - y_m), height_m), abs=1e-6)


@given(st.floats(0.1, 5.0), st.floats(0.1, 2.0), st.floats(0.5, 50.0), seeds)
def test_legs_are_straight_at_full_speed_and_no_longer_than_the_longest(
    speed_mps: float, step_s: float, leg_max_s: float, seed: int
) -> None:
    """Far from walls: one velocity, the same to the bit, for at most `leg_max_s` rounded up to steps."""
    settings = an_agent(width_m=1e5, height_m=1e5, speed_mps=speed_mps, step_s=step_s)
    legs = Walk(settings, leg_max_s, random.Random(seed))
    lengths: list[int] = []
    last: Velocity | None = None
    for now in range(300):
        velocity = legs.velocity(now, 5e4, 5e4)
        assert math.hypot(*velocity) == pytest.approx(speed_mps)
        lengths = [*lengths[:-1], lengths[-1] + 1] if velocity == last else [*lengths, 1]
        last = velocity
    assert max(lengths) <= math.ceil(leg_max_s / step_s)


def test_legs_last_uniform_0_to_the_longest() -> None:
    """Mean 50 s, rounded up to steps, and every decile has its share, over 4,000 legs of a fixed seed."""
    legs = Walk(an_agent(width_m=1e5, height_m=1e5), LEG_MAX_S, random.Random(3))
    lengths = [0]
    last = None
    for now in count():
        if len(lengths) > 4000:
            break
        velocity = legs.velocity(now, 5e4, 5e4)
        if velocity == last:
            lengths[-1] += 1
        else:
            lengths.append(1)
        last = velocity
    done = lengths[1:-1]
    assert 49.0 < sum(done) / len(done) < 52.0
    deciles = [sum(10 * tenth < length <= 10 * (tenth + 1) for length in done) for tenth in range(10)]
    assert all(320 <= count <= 480 for count in deciles), deciles


def test_headings_are_uniform() -> None:
    """Of 4,000 turns each eighth of the circle has its share, and they do not depend on one another."""
    settings = an_agent(width_m=1e5, height_m=1e5)
    legs = Walk(settings, LEG_MAX_S, random.Random(4))
    headings = []
    for now in range(4000):
        legs.turn(now, 5e4, 5e4)
        vx_mps, vy_mps = legs.velocity(now, 5e4, 5e4)
        headings.append(math.atan2(vy_mps, vx_mps) % math.tau)
    eighths = [int(heading / math.tau * 8) for heading in headings]
    assert all(420 <= eighths.count(eighth) <= 580 for eighth in range(8))
    turns = [(b - a) % math.tau for a, b in pairwise(headings)]
    assert abs(sum(map(math.cos, turns))) / len(turns) < 0.05


@given(st.tuples(*[st.floats(0.0, 100.0)] * 4), speeds_mps, steps_s)
def test_the_way_to_a_place_is_straight_and_ends_on_it(
    places: tuple[float, ...], speed_mps: float, step_s: float
) -> None:
    """At the speed limit, and the last stride as short as needed; never beyond."""
    x_m, y_m, to_x_m, to_y_m = places
    settings = an_agent(speed_mps=speed_mps, step_s=step_s)
    distance_m = math.hypot(to_x_m - x_m, to_y_m - y_m)
    vx_mps, vy_mps = towards(*places, settings)
    assert math.hypot(vx_mps, vy_mps) <= speed_mps * (1 + 1e-9)
    after_m = math.hypot(to_x_m - x_m - vx_mps * step_s, to_y_m - y_m - vy_mps * step_s)
    assert after_m == pytest.approx(max(0.0, distance_m - speed_mps * step_s), abs=1e-9)


def test_who_is_at_a_place_stands() -> None:
    """No division by a distance of nothing."""
    assert towards(3.0, 4.0, 3.0, 4.0, an_agent()) == STAND


@pytest.mark.parametrize(("x_m", "y_m"), [(-5.0, 50.0), (50.0, 103.0), (-5.0, -5.0)])
def test_a_walk_keeps_the_speed_limit_outside_the_arena(x_m: float, y_m: float) -> None:
    """A body that was put beyond a wall, as a real one may be, walks back no faster than it can."""
    assert math.hypot(*Walk(an_agent(), LEG_MAX_S, random.Random(1)).velocity(0, x_m, y_m)) <= 1.0 + 1e-9


walls = st.builds(
    an_agent,
    width_m=st.floats(1.0, 200.0),
    height_m=st.floats(1.0, 200.0),
    speed_mps=st.floats(0.01, 50.0),
    step_s=st.floats(0.01, 10.0),
)


def assert_promises_hold(shared: AgentSettings, leg_max_s: float, seed: int, x_m: float, y_m: float) -> None:
    """Where one walk is asked when its promise ends, and its twin in each step, both have the same velocities."""
    asked, left = (Walk(shared, leg_max_s, random.Random(seed)) for _ in range(2))
    due = 0
    velocity: Velocity = STAND
    for now in range(120):
        if now == due:
            velocity = left.velocity(now, x_m, y_m)
            due = left.straight_until(now, x_m, y_m, velocity)
            assert now < due <= now + MAX_POSES
        assert asked.velocity(now, x_m, y_m) == velocity, (now, due)
        x_m, y_m = x_m + velocity[0] * shared.step_s, y_m + velocity[1] * shared.step_s


@given(walls, shares | st.floats(-0.5, 1.5), shares | st.floats(-0.5, 1.5), st.floats(0.1, 500.0), seeds)
def test_an_agent_left_alone_walks_as_one_that_is_asked_in_each_step(
    shared: AgentSettings, right: float, up: float, leg_max_s: float, seed: int
) -> None:
    """`straight_until` never promises a step in which the velocity would have differed, by as much as one bit."""
    assert_promises_hold(shared, leg_max_s, seed, right * shared.width_m, up * shared.height_m)


@given(st.lists(polygons(), min_size=1, max_size=2), places, st.floats(0.01, 10.0), st.floats(0.05, 5.0), seeds)
def test_promises_hold_among_obstacles(
    obstacles: list[ObstacleSettings], place: Place, speed_mps: float, step_s: float, seed: int
) -> None:
    """The same where the walk is reflected by obstacles, also from within one."""
    shared = an_agent(width_m=SIDE_M, height_m=SIDE_M, speed_mps=speed_mps, step_s=step_s)
    assert_promises_hold(replace(shared, obstacles=tuple(obstacles)), 500.0, seed, *place)


@given(walls, seeds)
def test_a_velocity_changes_at_turns_and_walls_only(shared: AgentSettings, seed: int) -> None:
    """Within a leg and away from walls it is bit-identical in each step."""
    legs = Walk(shared, 20.0, random.Random(seed))
    stride_m = shared.speed_mps * shared.step_s
    place = [shared.width_m / 2, shared.height_m / 2]
    for now in range(60):
        before, ends = (legs.vx_mps, legs.vy_mps), legs.ends
        velocity = legs.velocity(now, *place)
        far = stride_m < place[0] < shared.width_m - stride_m and stride_m < place[1] < shared.height_m - stride_m
        if now < ends and far:
            assert velocity == before
        place = [at + speed_mps * shared.step_s for at, speed_mps in zip(place, velocity, strict=True)]


@pytest.mark.parametrize("step_s", [0.1, 0.3, 1.0])
def test_a_promise_keeps_off_the_walls(step_s: float) -> None:
    """Where a stride ends on a wall, rounding decides whether the agent turns there: it is asked before."""
    shared = an_agent(width_m=10.0, height_m=10.0, step_s=step_s)
    for tenths in range(100):
        asked, left = (Walk(shared, LEG_MAX_S, random.Random(1)) for _ in range(2))
        for legs in (asked, left):
            legs.vx_mps, legs.vy_mps, legs.ends = 1.0, 0.0, 2**32
        x_m, due, velocity = tenths / 10, 0, STAND
        for now in range(300):
            if now == due:
                velocity = left.velocity(now, x_m, 5.0)
                due = left.straight_until(now, x_m, 5.0, velocity)
            assert asked.velocity(now, x_m, 5.0) == velocity, (tenths, now)
            x_m += velocity[0] * step_s


def test_an_agent_on_a_long_leg_is_asked_seldom() -> None:
    """In the middle of a large arena the promise reaches to the leg's end, or as far as a promise may."""
    shared = an_agent(width_m=1e4, height_m=1e4)
    legs = Walk(shared, ENDLESS_S, random.Random(1))
    velocity = legs.velocity(0, 5e3, 5e3)
    assert legs.straight_until(0, 5e3, 5e3, velocity) == MAX_POSES
    short = Walk(shared, 10.0, random.Random(1))
    assert short.straight_until(0, 5e3, 5e3, short.velocity(0, 5e3, 5e3)) == short.ends


@given(seeds, st.floats(0.2, 1e4), st.floats(0.0, 10.0))
def test_a_leg_is_no_longer_than_the_longest(seed: int, leg_max_s: float, exponent: float) -> None:
    """Also where that is below the shortest leg of a Levy walk."""
    assert 0.0 <= leg_s(random.Random(seed), leg_max_s, exponent) <= leg_max_s * (1 + 1e-9)


@in_one_test(("exponent", "longer_than_10_s"), [(0.0, 0.9), (1.0, 0.5), (2.0, 0.0909), (3.0, 0.0099)])
def test_legs_of_a_levy_walk_follow_a_power_law(exponent: float, longer_than_10_s: float) -> None:
    """Of legs from 1 to 100 s, the share that is longer than 10 s; of uniform ones, from 0 s on, nine tenths."""
    rng = random.Random(7)
    legs_s = [leg_s(rng, 100.0, exponent) for _ in range(20_000)]
    assert sum(duration_s > 10 for duration_s in legs_s) / 20_000 == pytest.approx(longer_than_10_s, abs=0.01, rel=0.15)
