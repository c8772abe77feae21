"""Bodies and events: motion within limits, sensing, work, and the area that trees cover."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from deltaswarm_world.core.environment import COVERAGE_EVERY_S, Coverage, Environment, EventRecord
from tests.support.cores import play, swarm
from tests.support.tiers import in_one_test


def environment(**tables: Any) -> Environment:
    base: dict[str, Any] = {"agents": {"count": 3}, "events": {"rate_hz": 0}, "run": {}}
    return Environment(load(Scenario, {name: {**base.get(name, {}), **tables.get(name, {})} for name in base}))


def with_event(x_m: float, y_m: float, **tables: Any) -> Environment:
    made = environment(events={"rate_hz": 0, "work_agent_s": 10}, **tables)
    made.add([EventRecord(1, x_m, y_m, 0.0)])
    return made


SMOKE = {
    "arena": {"width_m": 40, "height_m": 40},
    "events": {"rate_hz": 0.1, "density": {"mean_m": [20, 20], "covariance_m2": [[30, 0], [0, 30]]}},
}


def test_another_seed_gives_other_events() -> None:
    one, other = (Environment(load(Scenario, {**SMOKE, "seed": seed})) for seed in (1, 2))
    assert not np.array_equal(one.positions_m, other.positions_m)
    for step in range(100):
        one.arrive(float(step))
        other.arrive(float(step))
    assert [e.x_m for e in one.arrived] != [e.x_m for e in other.arrived]


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0.1, 50))
def test_no_body_is_faster_than_the_limit(vx_mps: float, vy_mps: float, speed_mps: float) -> None:
    made = environment(agents={"speed_mps": speed_mps})
    made.command(1, vx_mps, vy_mps)
    got = np.array(made.velocities_mps[1])
    wanted = math.hypot(vx_mps, vy_mps)
    assert math.hypot(*got) <= speed_mps * (1 + 1e-12)
    if wanted <= speed_mps:
        assert tuple(got) == (vx_mps, vy_mps)
    else:
        assert got * wanted == pytest.approx(np.array([vx_mps, vy_mps]) * speed_mps, abs=1e-9)


@given(st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=1, max_size=30))
def test_walls_hold(commands: list[tuple[float, float]]) -> None:
    """Whatever is commanded: a body slides along the wall that it is driven against."""
    made = environment(agents={"speed_mps": 60.0})
    for vx_mps, vy_mps in commands:
        made.command(0, vx_mps, vy_mps)
        before = made.positions_m[0] + np.array(made.velocities_mps[0])
        made.move()
        assert np.all(made.positions_m >= 0)
        assert np.all(made.positions_m <= 100)
        assert made.positions_m[0] == pytest.approx(np.clip(before, 0, 100))


def test_bodies_move_by_velocity_times_step() -> None:
    made = environment(run={"step_s": 0.5})
    made.positions_m[:] = 50.0
    made.command(2, 0.6, -0.8)
    for _ in range(4):
        made.move()
    assert made.positions_m.tolist() == [[50, 50], [50, 50], [pytest.approx(51.2), pytest.approx(48.4)]]


def test_agents_begin_uniformly_in_the_arena() -> None:
    found = Environment(load(Scenario, {"agents": {"count": 2000}, "arena": {"width_m": 300}})).positions_m
    assert np.all(found >= 0)
    assert np.all(found <= [300, 100])
    quarters = (found[:, 0] > 150) * 2 + (found[:, 1] > 50)
    assert np.allclose(np.bincount(quarters) / 2000, 0.25, atol=0.04)


@pytest.mark.parametrize(("distance_m", "sensed"), [(0.0, True), (5.0, True), (5.001, False)])
def test_an_event_is_sensed_within_range(distance_m: float, sensed: bool) -> None:
    made = with_event(50.0, 50.0)
    made.positions_m[:] = [[50 + distance_m, 50], [50, 90], [50, 50 - distance_m]]
    found = made.sense(1.0, [True] * 3)
    assert [len(events) for events in found] == [sensed, 0, sensed]
    assert (made.arrived[0].sensed_s == 1.0) == sensed


def test_waiting_ends_when_any_agent_has_the_event_in_range() -> None:
    """Whether or not it observes it; the first time counts, and absent agents sense nothing."""
    made = with_event(50.0, 50.0)
    made.positions_m[:] = [[50, 50], [0, 0], [0, 0]]
    made.sense(3.0, [False, True, True])
    assert made.arrived[0].sensed_s is None
    for time_s in (4.0, 9.0):
        made.sense(time_s, [True] * 3)
        made.work({}, time_s)
    assert (made.arrived[0].sensed_s, made.arrived[0].work_agent_s) == (4.0, 0.0)


def test_a_passing_free_agent_ends_an_events_waiting() -> None:
    """Hierarchical agents never observe alone, and yet what they come by has been sensed."""
    crew = swarm("smoke", "control.mode=hierarchical", "control.rho=1000", "events.rate_hz=0.5")
    for _ in play(crew, 200):
        pass
    found = crew.world.environment.states()
    assert any(e.sensed_s is not None and e.sensed_s > e.arrived_s for e in found)
    assert all(e.work_agent_s == 0 and e.completed_s is None for e in found)


def test_work_begins_with_the_first_observer() -> None:
    """Sensing an event is not yet work on it, and a pause does not begin anew."""
    made = with_event(50.0, 50.0)
    event = made.arrived[0].event
    for time_s, observers in ((2.0, 0), (3.0, 0), (5.0, 2), (6.0, 0), (7.0, 1)):
        made.changed.clear()
        made.work({event: observers} if observers else {}, time_s)
        assert bool(made.changed) == (time_s == 5.0)
    assert made.states()[0].worked_s == 5.0


@given(st.lists(st.integers(0, 4), max_size=40), st.sampled_from([0.5, 1.0, 2.0]))
def test_work_is_linear_in_the_number_of_observers(observers: list[int], step_s: float) -> None:
    """Observers x time until the work is done: complete in that step, never before, and then no more."""
    made = with_event(50.0, 50.0, run={"step_s": step_s})
    event = made.arrived[0]
    done = 0.0
    for step, count in enumerate(observers):
        was_complete = event.completed_s is not None
        made.work({event.event: count, 999: 5}, float(step))
        done += 0.0 if was_complete else count * step_s
        assert event.work_agent_s == pytest.approx(done)
        assert (event.completed_s is not None) == (done >= 10)
        assert made.active == ([] if done >= 10 else [event])
        if not was_complete and done >= 10:
            assert event.completed_s == float(step)


def test_changes_are_told_once() -> None:
    """Arrival, first sensing, the start of work and completion; who begins a step forgets those of the one before."""
    made = with_event(50.0, 50.0)
    made.positions_m[:] = 50.0
    made.changed.clear()
    made.sense(0.0, [True] * 3)
    made.sense(1.0, [True] * 3)
    assert made.changed == made.arrived
    made.changed.clear()
    for time_s, changes in ((1.0, 1), (1.5, 0)):
        made.work({made.arrived[0].event: 1}, time_s)
        assert len(made.changed) == changes
        made.changed.clear()
    made.work({made.arrived[0].event: 9}, 2.0)
    assert made.changed == made.arrived


places = st.tuples(st.floats(0, 100), st.floats(0, 60))


def coverage(**tables: Any) -> Coverage:
    return Coverage(load(Scenario, {"arena": {"width_m": 100, "height_m": 60}, **tables}))


def area_m2(*members: tuple[float, float], **tables: Any) -> float:
    return coverage(**tables).area_m2(np.array(members).reshape(-1, 2))


def by_hand_m2(members: list[tuple[float, float]]) -> int:
    """Cells of 1 m whose centre is within 5 m of a member."""
    return sum(
        any((x + 0.5 - mx) ** 2 + (y + 0.5 - my) ** 2 <= 25 for mx, my in members)
        for x in range(100)
        for y in range(60)
    )


@pytest.mark.parametrize("range_m", [3.0, 7.5, 20.0])
def test_the_disc_grows_with_the_sensing_range(range_m: float) -> None:
    found = area_m2((50.0, 30.0), agents={"sensing_range_m": range_m})
    assert found == pytest.approx(math.pi * range_m**2, abs=math.tau * range_m / 3)


@given(st.lists(places, max_size=6))
def test_the_area_is_the_union_within_the_arena(members: list[tuple[float, float]]) -> None:
    """What two members cover counts once, what is beyond the walls not at all."""
    assert area_m2(*members) == by_hand_m2(members)


@in_one_test("step_s", [0.5, 1.0, 4.0, 60.0])
def test_coverage_is_measured_each_10_s(step_s: float) -> None:
    measure = coverage(run={"step_s": step_s})
    due = [step for step in range(100) if measure.is_due(step)]
    assert due == list(range(0, 100, max(1, round(COVERAGE_EVERY_S / step_s))))
