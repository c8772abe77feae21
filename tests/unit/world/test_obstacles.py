"""Obstacles in the world: bodies stay outside, and neither frames nor sight cross them."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from deltaswarm_orchestrator.inspect.link_report import examine
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from deltaswarm_wire.obstacles import ObstacleSettings
from deltaswarm_world.core.environment import Environment, EventRecord
from deltaswarm_world.core.obstacles import Obstacles
from tests.support.airs import OBSTACLES, Stage
from tests.support.cores import play, swarm
from tests.support.shapes import SIDE_M, Place, deepest_m, depth_m, places, polygons
from tests.support.tiers import in_one_test

SQUARE = ObstacleSettings(((10.0, 10.0), (20.0, 10.0), (20.0, 20.0), (10.0, 20.0)))
NEAR_M = 1e-4
"""What is nearer to an edge than this is not judged: the reference samples, and rounds in another way."""


def array(*rows: Place) -> Any:
    return np.array(rows, dtype=np.float64)


@given(polygons(), places)
def test_inside_is_inside(obstacle: ObstacleSettings, place: Place) -> None:
    depth = depth_m(obstacle, place)
    assume(abs(depth) > NEAR_M)
    assert Obstacles([obstacle]).inside(array(place))[0] == (depth > 0)


@given(polygons(), places, places)
def test_a_line_through_an_obstacle_is_crossed_from_both_ends(obstacle: ObstacleSettings, a: Place, b: Place) -> None:
    """A line that goes deeper than the edge is cut; one that stays away from the edge is not."""
    made = Obstacles([obstacle])
    there, back = (bool(made.hide(array(p), array(q))[0]) for p, q in ((a, b), (b, a)))
    deepest = deepest_m(obstacle, a, b)
    assume(abs(deepest) > NEAR_M)
    if deepest > 0:
        assert there
        assert back
    elif deepest < -0.3:  # a corner may stick out between two samples
        assert not there
        assert not back


@given(
    st.lists(polygons(), min_size=1, max_size=3), places, st.lists(st.tuples(*[st.floats(-30, 30)] * 2), max_size=20)
)
def test_no_body_enters_an_obstacle(obstacles: list[ObstacleSettings], start: Place, strides: list[Place]) -> None:
    """However far its strides lead; and it leaves the edge again."""
    made = Obstacles(obstacles)
    here = array(start)
    assume(not made.inside(here)[0])
    for stride in strides:
        there = np.clip(here + array(stride), 0, SIDE_M)
        end = made.stop(here, there)
        assert not made.inside(end)[0]
        (before,), (after,) = here.tolist(), end.tolist()
        for obstacle in obstacles:
            assert deepest_m(obstacle, (before[0], before[1]), (after[0], after[1]), 50) < NEAR_M
        here = end


@in_one_test(
    ("to", "stops"),
    [
        ((15.0, 15.0), (10.0, 15.0)),
        ((30.0, 15.0), (10.0, 15.0)),
        ((0.0, 15.0), (0.0, 15.0)),
        ((5.0, 30.0), (5.0, 30.0)),
        ((15.0, 25.0), (10.0, 20.0)),
    ],
)
def test_a_body_stops_at_the_edge(to: Place, stops: Place) -> None:
    assert Obstacles([SQUARE]).stop(array((5.0, 15.0)), array(to))[0] == pytest.approx(stops, abs=1e-5)


def test_a_body_at_the_edge_is_free_to_leave() -> None:
    """It goes on away from the edge and along it, and not a bit into it."""
    made = Obstacles([SQUARE])
    edge = made.stop(array((5.0, 15.0)), array((15.0, 15.0)))
    for way, goes in (((-1.0, 0.3), True), ((0.0, 3.0), True), ((1.0, 0.1), False)):
        moved = made.stop(edge, edge + array(way))[0] - edge[0]
        assert moved == pytest.approx(way if goes else (0.0, 0.0), abs=1e-5)


UNIFORM = {"rate_hz": 1.0, "density": {"kind": "uniform"}}


def environment(obstacle: ObstacleSettings, seed: int = 1) -> Environment:
    arena = {"width_m": SIDE_M, "height_m": SIDE_M, "obstacles": [{"corners_m": obstacle.corners_m}]}
    return Environment(load(Scenario, {"seed": seed, "arena": arena, "events": UNIFORM, "agents": {"count": 20}}))


@given(polygons(), st.integers(0, 99))
def test_nothing_begins_in_an_obstacle(obstacle: ObstacleSettings, seed: int) -> None:
    """Neither an agent nor an event; places outside are those of the arena without obstacles."""
    made = environment(obstacle, seed)
    arena = {"width_m": SIDE_M, "height_m": SIDE_M}
    open_arena = Environment(load(Scenario, {"seed": seed, "arena": arena, "events": UNIFORM, "agents": {"count": 20}}))
    for step in range(10):
        made.arrive(float(step))
    starts = [(x, y) for x, y in made.positions_m.tolist()]
    assert max(depth_m(obstacle, place) for place in [*starts, *((e.x_m, e.y_m) for e in made.arrived)]) < NEAR_M
    moved = (made.positions_m != open_arena.positions_m).any(axis=1)
    assert all(depth_m(obstacle, (x, y)) > -NEAR_M for x, y in open_arena.positions_m[moved].tolist())


def test_an_obstacle_over_everything_is_a_clear_error() -> None:
    everywhere = ObstacleSettings(((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M)))
    with pytest.raises(ValueError, match=r"arena\.obstacles"):
        environment(everywhere)


def test_an_event_behind_an_obstacle_is_not_sensed() -> None:
    """Only in the line of sight, even of an obstacle that lets radio through."""
    obstacle = {"corners_m": SQUARE.corners_m, "attenuation_db": 1.0}
    scenario = {"arena": {"obstacles": [obstacle]}, "agents": {"count": 2, "sensing_range_m": 15}}
    made = Environment(load(Scenario, {**scenario, "events": {"rate_hz": 0}}))
    made.positions_m = array((9.0, 15.0), (21.0, 9.0))
    made.add([EventRecord(1, 21.0, 15.0, 0.0)])
    assert [len(events) for events in made.sense(0.0, [True, True])] == [0, 1]


def stage(positions_m: list[list[float]], attenuation_db: float | None = None, **radio: Any) -> Stage:
    obstacle: dict[str, Any] = {"corners_m": [list(corner) for corner in SQUARE.corners_m]}
    if attenuation_db is not None:
        obstacle["attenuation_db"] = attenuation_db
    return Stage(positions_m, arena={"obstacles": [obstacle]}, **{"range_m": 30.0, **radio})


@given(st.lists(places, min_size=2, max_size=8), polygons(), st.sampled_from(["disc", "log-distance"]))
def test_no_link_crosses_an_obstacle_that_blocks(
    positions_m: list[Place], obstacle: ObstacleSettings, reception: str
) -> None:
    table = {"obstacles": [{"corners_m": [list(corner) for corner in obstacle.corners_m]}]}
    carried = Stage(positions_m, arena=table, range_m=100.0, reception=reception).carry()
    for sender, receiver in carried.links:
        assert deepest_m(obstacle, positions_m[sender], positions_m[receiver]) < NEAR_M
        assert (receiver, sender) in carried.links


def test_an_obstacle_is_a_reason_of_its_own() -> None:
    carried = stage([[5, 15], [25, 15], [5, 25]]).carry([0])
    assert (carried.links, carried.dropped) == ([(0, 2)], {"obstacle": 1})


@pytest.mark.parametrize(("distance_m", "heard"), [(14.9, True), (15.1, False)])
def test_with_a_disc_attenuation_shortens_the_range(distance_m: float, heard: bool) -> None:
    """By 10^(-L / (10 exponent)): 30 dB / 3 a decade, so 9.03 dB halve a range of 30 m."""
    made = stage([[8.0, 15.0], [8.0 + distance_m, 15.0]], float(30 * np.log10(2)))
    assert (len(made.carry([0]).links) == 1) == heard


@pytest.mark.parametrize(("attenuation_db", "heard"), [(0.0, True), (1.9, True), (2.1, False)])
def test_by_power_attenuation_is_subtracted(attenuation_db: float, heard: bool) -> None:
    """At 12 m 72.4 dBm are lost; 2 dB to spare are 2 dB."""
    path_loss = {"shadowing_db": 0.0, "sensitivity_dbm": -float(40 + 30 * np.log10(12) + 2)}
    made = stage([[9.0, 15.0], [21.0, 15.0]], attenuation_db, reception="log-distance", path_loss=path_loss)
    assert (len(made.carry([0]).links) == 1) == heard


RUN = ("record=off", "agents.count=10", "events.rate_hz=0.3", "events.density.kind=uniform", "run.duration_s=300")


def test_a_swarm_lives_with_obstacles_and_is_the_same_again() -> None:
    """Nobody is ever inside, agents keep moving, events are completed; the same run again, not the open arena's."""
    crew = swarm("smoke", *RUN, OBSTACLES)
    obstacles = Obstacles(crew.scenario.arena.obstacles)
    moved = np.zeros(10)
    before = crew.world.environment.positions_m
    for _ in play(crew, 300):
        here = crew.world.environment.positions_m
        assert not obstacles.inside(here).any()
        moved += np.hypot(*(here - before).T)
        before = here
    assert moved.min() > 5
    assert sum(event.completed_s is not None for event in crew.world.environment.states()) > 5
    digests = [
        run_in_process(load_scenario("smoke", [*RUN, *more], seed=1)).digest for more in ([OBSTACLES], [OBSTACLES], [])
    ]
    assert digests[0] == digests[1] != digests[2]


def test_why_names_the_obstacle() -> None:
    wall = "arena.obstacles=[{corners_m=[[0,19],[40,19],[40,21],[0,21]]}]"
    scenario = load_scenario("smoke", [*RUN, "radio.range_m=100", wall], seed=2)
    answers = [examine(scenario, 0, receiver, 30, []) for receiver in range(1, 10)]
    assert {answer.reason for answer in answers} == {None, "obstacle"}
    said = {finding["says"] for answer in answers for finding in answer.findings if finding["reason"] == "obstacle"}
    assert {"obstacle 0" in text for text in said} == {True, False}
