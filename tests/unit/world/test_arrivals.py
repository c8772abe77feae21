"""Arrivals: when, where and of which class, the same whatever is not about them."""

import math
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.results.outcome import arrival_digests
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.task import TaskSettings
from deltaswarm_wire.checked import SettingsError, load
from deltaswarm_world.core.arrivals import Arrival, Arrivals, EventClasses, Expected
from deltaswarm_world.core.density import Places
from deltaswarm_world.core.environment import Environment
from deltaswarm_world.core.obstacles import Obstacles
from tests.swarms.test_checkpoint_cores import digests

STANDS = {"mean_m": [20.0, 20.0], "covariance_m2": [[30.0, 0.0], [0.0, 30.0]]}
MOVES = {**STANDS, "path_m": [[5.0, 5.0], [35.0, 5.0], [20.0, 35.0]], "path_s": [0.0, 100.0, 150.0]}
BLOCK = {"corners_m": [[10.0, 10.0], [22.0, 10.0], [22.0, 22.0], [10.0, 22.0]]}


def scenario(seed: int, **tables: Any) -> Scenario:
    base: dict[str, Any] = {
        "seed": seed,
        "arena": {"width_m": 40.0, "height_m": 40.0},
        "events": {"rate_hz": 0.2, "density": STANDS},
    }
    for name, table in tables.items():
        base[name] = {**base.get(name, {}), **table}
    return load(Scenario, base)


def arrivals(of: Scenario, until_s: float = 200.0) -> list[Arrival]:
    places = Places(of.events.density, of.arena, Obstacles(of.arena.obstacles))
    return list(Arrivals(of, places).until(until_s))


@given(
    seed=st.integers(0, 2**31),
    step_s=st.sampled_from([0.1, 0.25, 0.5, 2.0, 5.0, 20.0]),
    density=st.sampled_from([STANDS, MOVES]),
)
def test_the_step_changes_no_arrival(seed: int, step_s: float, density: dict[str, Any]) -> None:
    """Neither number, time nor place; each event is there from the first step that is not before its time."""
    expected = arrivals(scenario(seed, events={"density": density}))
    environment = Environment(scenario(seed, events={"density": density}))
    for step in range(round(200.0 / step_s) + 1):
        before = len(environment.arrived)
        environment.arrive(step * step_s)
        for event in environment.arrived[before:]:
            assert step * step_s - step_s < event.arrived_s <= step * step_s
    assert [(e.event, e.x_m, e.y_m, e.arrived_s) for e in environment.arrived] == expected


@given(seed=st.integers(0, 2**31), factor=st.sampled_from([0.5, 2.0, 8.0]))
def test_the_rate_scales_times_and_leaves_places(seed: int, factor: float) -> None:
    """Twice the rate is the same events in half the time."""
    slow, fast = arrivals(scenario(seed)), arrivals(scenario(seed, events={"rate_hz": 0.2 * factor}))
    count = min(len(slow), len(fast))
    assert [event[:3] for event in fast[:count]] == [event[:3] for event in slow[:count]]
    assert [event.time_s * factor for event in fast[:count]] == pytest.approx([event.time_s for event in slow[:count]])


@given(seed=st.integers(0, 2**31))
def test_an_obstacle_moves_only_the_events_that_it_must(seed: int) -> None:
    free, blocked = arrivals(scenario(seed)), arrivals(scenario(seed, arena={"obstacles": [BLOCK]}))
    assert [(event.event, event.time_s) for event in blocked] == [(event.event, event.time_s) for event in free]
    for before, after in zip(free, blocked, strict=True):
        is_inside = 10 < before.x_m < 22 and 10 < before.y_m < 22
        assert (before == after) != is_inside
        assert not (10 < after.x_m < 22 and 10 < after.y_m < 22)


@given(
    seed=st.integers(0, 2**31),
    sets=st.fixed_dictionaries(
        {},
        optional={
            "control.mode": st.sampled_from(["decentralised", "hierarchical", "hybrid", "potential"]),
            "agents.count": st.integers(1, 6),
            "agents.sensing_range_m": st.floats(1, 10),
            "radio.loss": st.floats(0, 1),
            "radio.range_m": st.floats(7, 20),
            "radio.latency_s": st.integers(0, 3),
            "events.work_agent_s": st.floats(1, 400),
            "run.step_s": st.sampled_from([0.5, 2.0, 4.0]),
        },
    ),
)
def test_no_run_changes_its_arrivals(seed: int, sets: dict[str, Any]) -> None:
    """Whatever the swarm, its radio and the step are: the digests of times and places agree to the end of the run."""
    base = ["run.duration_s=40", "events.rate_hz=0.5", "metrics.horizon_s=10"]
    plain = run_in_process(load_scenario("smoke", [*base, "control.mode=decentralised", "agents.count=1"], seed))
    other = run_in_process(load_scenario("smoke", [*base, *(f"{name}={value}" for name, value in sets.items())], seed))
    assert arrival_digests(other.events) == arrival_digests(plain.events)
    assert all(event.arrived_s <= 40 for event in plain.events)


def test_digests_tell_times_from_places() -> None:
    """Another rate shifts the times alone, another density the places alone."""
    runs = [
        run_in_process(load_scenario("smoke", ["run.duration_s=60", more], 3))
        for more in ("agents.count=2", "events.density.mean_m=[15, 15]", "arena.width_m=41")
    ]
    (times, places), (same_times, other_places), same = (arrival_digests(run.events) for run in runs)
    assert (times == same_times, places == other_places) == (True, False)
    assert same == (times, places)


def test_the_cost_of_arrivals_is_linear_in_their_number() -> None:
    """In one step or many: 16 times as many events cost at most 50 times as much, where squares would cost 256."""

    def seconds(rate_hz: float) -> float:
        environment = Environment(scenario(5, events={"rate_hz": rate_hz}))
        began = time.process_time()
        environment.arrive(20.0)
        assert len(environment.arrived) == pytest.approx(20 * rate_hz, rel=0.3)
        return time.process_time() - began

    few, many = (min(seconds(rate_hz) for _ in range(3)) for rate_hz in (25.0, 400.0))
    assert many < 50 * few


def test_times_are_exponential_and_independent_of_one_another_and_of_places() -> None:
    """The gaps of 4,000 arrivals have the mean and the spread of an exponential distribution; seed 9."""
    found = arrivals(scenario(9), 20_000.0)
    gaps = np.diff([event.time_s for event in found])
    assert len(found) == pytest.approx(4000, abs=4 * 4000**0.5)
    assert gaps.mean() == pytest.approx(5.0, rel=0.07)
    assert gaps.std() == pytest.approx(5.0, rel=0.1)
    assert len({event.event for event in found}) == len(found)
    assert abs(np.corrcoef(gaps[1:], gaps[:-1])[0, 1]) < 0.06
    assert abs(np.corrcoef(gaps, [event.x_m for event in found[1:]])[0, 1]) < 0.06


SIZE_M = np.array([100.0, 100.0])
TASK = "operator.task={target_share=0.5, target_jump_m=0.5, decoy_jump_m=4, jump_every_s=3}"


def classes(seed: int = 0, **table: Any) -> EventClasses:
    return EventClasses(TaskSettings(**table), seed, SIZE_M)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_the_share_of_targets_is_as_asked(share: float) -> None:
    one, other = (classes(seed, target_share=share) for seed in (1, 2))
    ids = range(2**62, 2**62 + 2000)
    targets = [one.is_target(event) for event in ids]
    assert sum(targets) / len(ids) == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / len(ids)))
    assert targets != [other.is_target(event) for event in ids]


def test_each_class_jumps_as_far_as_asked() -> None:
    """Along x and y, within an interval not at all, and never out of the arena."""
    one = classes(target_share=0.5, target_jump_m=0.3, decoy_jump_m=2.0, jump_every_s=10.0)
    for event in range(6):
        places_m = np.array([one.as_sensed(event, 50.0, 50.0, number)[1:] for number in range(1500)])
        jump_m = 0.3 if one.is_target(event) else 2.0
        assert places_m.std(axis=0) == pytest.approx(np.full(2, jump_m), rel=0.08)
        assert places_m.mean(axis=0) == pytest.approx(np.full(2, 50.0), abs=0.12 * jump_m)
        edge_m = np.array([one.as_sensed(event, 0.0, 100.0, number)[1:] for number in range(200)])
        assert edge_m.min() >= 0.0
        assert edge_m.max() <= 100.0
    assert [one.interval(time_s) for time_s in (0.0, 9.5, 10.0, 29.9, 30.0)] == [0, 0, 1, 2, 3]
    assert [classes(jump_every_s=0.3).interval(0.1 * step) for step in range(7)] == [0, 0, 0, 1, 1, 1, 2]


def test_a_run_with_classes_is_repeatable_and_goes_on_after_a_checkpoint() -> None:
    """Work is still done on all events; without classes nothing changes."""
    sets = ["run.duration_s=300", "control.mode=hybrid", "events.rate_hz=0.1", "events.work_agent_s=40"]
    plain, one, again = (run_in_process(load_scenario("smoke", [*sets, *more])) for more in ([], [TASK], [TASK]))
    assert one.digest == again.digest != plain.digest
    targets = one.world["targets"]
    assert plain.world["targets"] is None
    assert 0 < len(targets) < len(one.events)
    assert {event.event for event in one.events} > set(targets)
    assert sum(event.completed_s is not None for event in one.events) > 5
    with_classes = [*sets[1:], TASK]
    assert digests(with_classes, every=23) == digests(with_classes, every=301)


@pytest.mark.parametrize("seed", [3, 4])
def test_a_rate_that_changes_stretches_the_times_from_then_on(seed: int) -> None:
    """As an integral of the rate, by hand: 0.2 until 50 s, nothing until 80 s, then 0.4."""
    alone = [arrival.time_s for arrival in arrivals(scenario(seed))]
    changing = arrivals(scenario(seed, events={"rates_hz": [0.0, 0.4], "rates_s": [50.0, 80.0]}), 125.0)
    expected = [time_s if time_s <= 50 else 80 + (time_s - 50) / 2 for time_s in alone]
    assert [arrival.time_s for arrival in changing] == pytest.approx([time_s for time_s in expected if time_s <= 125])
    assert any(arrival.time_s > 80 for arrival in changing)


def test_a_number_is_reached_when_its_rate_ends() -> None:
    """Ten events are expected by 50 s, and as many until 80 s."""
    expected = Expected(scenario(1, events={"rates_hz": [0.0, 0.4], "rates_s": [50.0, 80.0]}).events)
    assert [expected.by(time_s) for time_s in (50.0, 65.0, 80.0, 90.0)] == pytest.approx([10, 10, 10, 14])
    assert [expected.time_s(number) for number in (10.0, 14.0)] == pytest.approx([50, 90])


def test_arrivals_drawn_anew_follow_the_rate_of_their_time() -> None:
    of = scenario(5, events={"rates_hz": [1.0], "rates_s": [90.0]})
    found = Arrivals(of, Places(of.events.density, of.arena, Obstacles(of.arena.obstacles)))
    list(found.until(100.0))
    found.redraw(6, 100.0)
    times_s = [arrival.time_s for arrival in found.until(1100.0)]
    assert 100 < times_s[0] < 115
    assert abs(len(times_s) - 1000) < 5 * 1000**0.5


@pytest.mark.parametrize("times_s", [[50.0], [50.0, 50.0], [80.0, 50.0], [0.0, 50.0]])
def test_rates_without_times_in_order_are_refused(times_s: list[float]) -> None:
    """A rate that holds from no time on, or two from the same, mean nothing."""
    with pytest.raises(SettingsError, match=r"events\.rates_s"):
        scenario(1, events={"rates_hz": [0.1, 0.2], "rates_s": times_s})


def test_a_bound_knows_one_rate_and_obeys_nobody() -> None:
    """So it is refused with several rates, and with a rule that gives orders."""
    with pytest.raises(SettingsError, match=r"run\.bound"):
        scenario(1, run={"bound": "density"}, events={"rates_hz": [0.1], "rates_s": [50.0]})
    with pytest.raises(SettingsError, match=r"run\.bound"):
        scenario(1, run={"bound": "density"}, operator={"autonomy": {"sets_delta": "budget"}})
