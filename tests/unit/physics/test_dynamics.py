"""Robots go where they are told, keep clear of each other and walls, feel what they touch, and repeat to the bit."""

import math
import pickle
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from deltaswarm_orchestrator.run.in_process import InProcess, run_in_process
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.operator_messages import Clock
from deltaswarm_world.core import environment as environment_module
from deltaswarm_world.core.environment import Environment
from tests.support.tiers import in_one_test, nightly
from tests.support.worlds import Stage

SQUARE_M = ((60.0, 50.0), (60.0, 60.0), (50.0, 60.0), (50.0, 50.0))
HERE_M = 0.01


def world(*overrides: str, starts: Sequence[Sequence[float]] = ()) -> Environment:
    given = [f"agents.count={len(starts)}", f"world.starts_m={[list(start) for start in starts]}"] if starts else []
    return Environment(load_scenario("paper-25", ["world.dynamics=physics", *given, *overrides], 5))


def send(
    environment: Environment, goals: Sequence[Sequence[float]], speed_mps: float = 1.0, step_s: float = 1.0
) -> None:
    """Command each robot straight to its goal, as agents do, and move by a step."""
    for robot, goal in enumerate(goals):
        dx, dy = (np.array(goal) - environment.positions_m[robot]).tolist()
        time_s = max(math.hypot(dx, dy) / speed_mps, step_s)
        environment.command(robot, dx / time_s, dy / time_s)
    environment.move()


@in_one_test(
    ("overrides", "step_s", "most_s"),
    [
        ([], 1.0, 56.0),
        ([], 0.5, 56.0),
        ([], 2.0, 56.0),
        (["world.radius_m=1.0"], 1.0, 56.0),
        (["world.drive=holonomic"], 1.0, 50.0),
        (["world.avoidance=none"], 1.0, 56.0),
        (["world.turn_rate_radps=0.5"], 1.0, 70.0),
    ],
)
def test_a_robot_drives_a_square(overrides: list[str], step_s: float, most_s: float) -> None:
    """Of 10 m a side, to within a centimetre of each corner; turning and braking cost some seconds."""
    environment = world(f"run.step_s={step_s}", "run.duration_s=120", *overrides, starts=[SQUARE_M[-1]])
    steps, ways_m = 0, []
    for corner in SQUARE_M:
        while math.dist(environment.positions_m[0], corner) > HERE_M:
            before = environment.positions_m[0].copy()
            send(environment, [corner], step_s=step_s)
            ways_m.append(math.dist(before, environment.positions_m[0]))
            steps += 1
            assert steps * step_s <= most_s
    assert steps * step_s >= 40.0
    assert max(ways_m) <= step_s + 0.01


@in_one_test(("avoidance", "passes"), [("proximity", True), ("none", False)])
def test_two_robots_that_meet_pass_each_other_if_they_keep_clear(avoidance: str, passes: bool) -> None:
    """Each turns to its right; without it they push each other, and both feel it."""
    goals = [(60.0, 50.0), (40.0, 50.0)]
    environment = world(f"world.avoidance={avoidance}", starts=goals[::-1])
    gaps_m, bumped = [], set()
    for _ in range(90):
        send(environment, goals)
        gaps_m.append(math.dist(*environment.positions_m))
        bumped |= environment.dynamics.bumped
        if environment.positions_m[0, 0] < 50.0 - 0.3:
            assert environment.positions_m[0, 1] <= 50.0 + 0.2, "it turned to its left"
    arrived = [math.dist(place, goal) <= HERE_M for place, goal in zip(environment.positions_m, goals, strict=True)]
    assert arrived == [passes, passes]
    assert bumped == (set() if passes else {0, 1})
    assert min(gaps_m) >= 2 * 0.25 * 0.95
    assert environment.dynamics.totals["jams"] == (0 if passes else 2)


def test_a_robot_at_a_wall_is_blocked_and_one_in_the_open_is_not() -> None:
    """Nor is one that stands where it was told to stand."""
    environment = world(starts=[(3.0, 50.0), (50.0, 50.0), (80.0, 50.0)])
    for _ in range(12):
        for robot, vx_mps in enumerate((-1.0, 1.0, 0.0)):
            environment.command(robot, vx_mps, 0.0)
        environment.move()
    assert environment.dynamics.blocked == {0}
    assert environment.positions_m[0, 0] == pytest.approx(0.25, abs=0.05)
    assert environment.positions_m[1, 0] > 60.0
    assert environment.positions_m[2].tolist() == pytest.approx([80.0, 50.0], abs=1e-6)


def test_blocked_time_and_jams_are_counted() -> None:
    """In half steps. Who slides along a wall is not blocked; who is, but gets on along it, is not jammed."""
    starts = [(1.0, 20.0), (50.0, 50.0), (1.0, 10.0), (1.0, 70.0)]
    environment = world("run.step_s=0.5", "run.duration_s=200", "world.drive=holonomic", starts=starts)
    jams = []
    for _ in range(160):
        for robot, (vx_mps, vy_mps) in enumerate([(-1.0, 0.0), (0.1, 0.0), (-0.1, 0.45), (-1.0, 0.3)]):
            environment.command(robot, vx_mps, vy_mps)
        environment.move()
        jams.append(environment.dynamics.totals["jams"])
    assert environment.dynamics.blocked == {0, 3}
    assert environment.dynamics.totals["blocked_share"] == pytest.approx(0.5, abs=0.02)
    assert jams[-1] == 1
    assert 120 <= jams.index(1) <= 125


def test_robots_that_stand_in_each_other_or_in_a_wall_are_misplaced() -> None:
    """Of two it is the one with the higher number; at a diameter apart nobody is."""
    dynamics = world("world.radius_m=1.0", starts=[(50.0, 50.0)]).dynamics
    places_m = np.array([[20.0, 20.0], [30.0, 30.0], [21.9, 20.0], [32.1, 30.0], [0.9, 50.0], [1.1, 70.0]])
    assert dynamics.misplaced(places_m).tolist() == [False, False, True, False, True, False]


def test_robots_without_room_to_start_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment_module, "MAX_TRIES", 2)
    crowd = ["world.dynamics=physics", "world.radius_m=2.9", "agents.count=150", "run.duration_s=1", "record=off"]
    [line] = run_in_process(load_scenario("paper-25", crowd)).messages
    assert line.startswith("the arena must leave room for 150 agents")


def test_a_jammed_robot_got_no_further_than_its_diameter() -> None:
    """One that creeps along a wall by 0.35 m a minute is jammed, and one that creeps by 0.54 m is not."""
    environment = world("world.drive=holonomic", "world.friction=0", starts=[(0.3, 20.0), (0.3, 70.0)])
    for _ in range(80):
        for robot, vy_mps in enumerate((0.006, 0.01)):
            environment.command(robot, -0.05, vy_mps)
        environment.move()
    assert environment.dynamics.blocked == {0, 1}
    assert environment.dynamics.totals["jams"] == 1


def faulty(fault: dict[str, Any], dynamics: str) -> tuple[Environment, Callable[[float, float], None]]:
    """A body with a fault, and what moves it by a step at a commanded velocity."""
    stage = Stage(1, world={"dynamics": dynamics}, fault=[fault])

    def go_on(vx_mps: float, vy_mps: float) -> None:
        stage.end()
        stage.core.environment.command(0, vx_mps, vy_mps)
        stage.core.inject(stage.step + 1)
        stage.begin()

    stage.core.inject(0)
    stage.begin()
    go_on(0.0, 0.0)
    return stage.core.environment, go_on


@pytest.mark.parametrize(("wheel", "side"), [("left", 1), ("right", -1)])
def test_a_robot_turns_to_the_side_of_the_wheel_that_it_lost(wheel: str, side: int) -> None:
    """Its wheel on the other side drives it round, and its own speeds say so."""
    fault = {"kind": "wheel-lost", "at_s": 0, "agents": [0], "wheel": wheel}
    environment, go_on = faulty(fault, "physics")
    [before] = environment.dynamics.states() or ()
    go_on(math.cos(before.heading_rad), math.sin(before.heading_rad))
    [after] = environment.dynamics.states() or ()
    assert math.remainder(after.heading_rad - before.heading_rad, 2 * math.pi) * side > 0.1
    speeds_mps = {"left": after.left_mps, "right": after.right_mps}
    assert abs(speeds_mps.pop(wheel)) < 0.01 < abs(*speeds_mps.values())


def test_a_robot_that_lost_a_wheel_turns_about_it() -> None:
    fault = 'fault=[{kind="wheel-lost",at_s=0,agents=[0],wheel="left"}]'
    run = InProcess(load_scenario("paper-25", ["world.dynamics=physics", "agents.count=2", "record='off'", fault], 5))
    start_m = run.world.environment.positions_m.copy()
    farthest_m = [0.0, 0.0]
    for step in range(100):
        run.step(step, False)
        for robot in (0, 1):
            away_m = math.dist(run.world.environment.positions_m[robot], start_m[robot])
            farthest_m[robot] = max(farthest_m[robot], away_m)
    assert 0.1 < farthest_m[0] < 1.0
    assert farthest_m[1] > 5.0


def test_a_body_that_drifts_moves_at_an_angle() -> None:
    """A right angle to the left of its command, robot or point."""
    for dynamics in ("physics", "point"):
        fault = {"kind": "actuator-drift", "at_s": 0, "agents": [0], "angle_deg": 90}
        environment, go_on = faulty(fault, dynamics)
        before_m = environment.positions_m[0].copy()
        for _ in range(3):
            go_on(1.0, 0.0)
        dx_m, dy_m = (environment.positions_m[0] - before_m).tolist()
        assert dy_m > 1.0
        assert abs(dx_m) < 0.5


def crowd(steps: int, **overrides: object) -> InProcess:
    """A swarm that jams: 50 robots that go to events in an arena with room for a few."""
    given = {"agents.count": 50, "arena.width_m": 11, "arena.height_m": 11, "events.density.mean_m": [5, 5]}
    given |= {
        "control.mode": "'decentralised'",
        "run.duration_s": steps,
        "record": "'off'",
        "world.dynamics": "'physics'",
    }
    return InProcess(load_scenario("paper-25", [f"{key}={value}" for key, value in (given | overrides).items()], 7))


def go(run: InProcess, begin: int, end: int) -> None:
    steps = run.scenario.run.steps
    for step in range(begin, end):
        record = run.step(step, step == steps - 1)
        run.close_step(Clock(step, record.time_s, step == steps - 1))


@pytest.mark.parametrize("avoidance", ["proximity", "none"])
def test_a_run_goes_on_from_a_checkpoint_in_a_jam_to_the_bit(avoidance: str) -> None:
    """From three moments, at all of which many robots are blocked, or touch each other if they keep no distance."""
    steps, moments = 100, (30, 55, 80)
    given = {"world.avoidance": f"'{avoidance}'"}
    whole = crowd(steps, **given)
    saved, begin = {}, 0
    for moment in (*moments, steps):
        go(whole, begin, moment)
        begin = moment
        if moment < steps:
            dynamics = whole.world.environment.dynamics
            assert len(dynamics.bumped if avoidance == "none" else dynamics.blocked) > 10
            saved[moment] = pickle.dumps((whole.world, whole.agents, whole.operator))
    for moment, data in saved.items():
        again = crowd(steps, **given)
        again.world, again.agents, again.operator = pickle.loads(data)
        go(again, moment, steps)
        assert again.world.digest.hex() == whole.world.digest.hex(), moment
        assert again.world.environment.positions_m.tolist() == whole.world.environment.positions_m.tolist(), moment


def closest(run: InProcess, radius_m: float) -> tuple[float, float]:
    """Run to the end; return the least distance of centres in diameters, and of centres from the edge in radii."""
    steps, size_m = run.scenario.run.steps, run.scenario.arena.width_m
    apart, inside = math.inf, math.inf
    for step in range(steps):
        go(run, step, step + 1)
        places_m = run.world.environment.positions_m
        distances_m = np.hypot(*(places_m[:, None] - places_m).transpose(2, 0, 1))
        distances_m[np.diag_indices(len(places_m))] = math.inf
        apart = min(apart, distances_m.min() / (2 * radius_m))
        inside = min(inside, places_m.min() / radius_m, (size_m - places_m.max()) / radius_m)
    return float(apart), float(inside)


LEAST = 1.0 - 0.06 / 2
"""Two radii less 6 % of a radius, in diameters: the engine's slop, and what it has not undone yet where many meet."""


def test_nobody_overlaps_and_nobody_leaves_the_arena() -> None:
    """In any pose of a run; at length in the nightly tier."""
    scenario = load_scenario("paper-25", ["world.dynamics=physics", "run.duration_s=300", "record='off'"], 11)
    apart, inside = closest(InProcess(scenario), 0.25)
    assert apart >= LEAST
    assert inside >= 1.0 - 0.02


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_nobody_overlaps_in_any_pose_of_20_runs(seed: int) -> None:
    """Of the paper's scenario, in all sizes and modes by turns."""
    radius_m, mode = (0.25, 0.5, 1.0)[seed % 3], ("decentralised", "hierarchical", "hybrid", "adaptive")[seed % 4]
    overrides = [f"world.radius_m={radius_m}", f"control.mode={mode}", "run.duration_s=1800", "record='off'"]
    apart, inside = closest(
        InProcess(load_scenario("paper-25", ["world.dynamics=physics", *overrides], seed)), radius_m
    )
    assert apart >= LEAST
    assert inside >= 1.0 - 0.02


@pytest.mark.parametrize("drive", ["differential", *nightly("holonomic")])
def test_nobody_gets_into_an_obstacle(drive: str) -> None:
    """Centres stay a radius away from its edges, less the slop, also where it is concave."""
    low, high = 40.0, 60.0
    corners = f"[[{low},{low}],[{high},{low}],[{high},{high}],[55,{high}],[55,45],[45,45],[45,{high}],[{low},{high}]]"
    overrides = [
        f"arena.obstacles=[{{corners_m={corners}}}]",
        "run.duration_s=300",
        "record='off'",
        f"world.drive={drive}",
    ]
    run = InProcess(load_scenario("paper-25", ["world.dynamics=physics", "world.radius_m=0.5", *overrides], 3))
    solid = [((low, low), (high, 45.0)), ((low, low), (45.0, high)), ((55.0, low), (high, high))]
    near = math.inf
    for step in range(300):
        go(run, step, step + 1)
        for place_m in run.world.environment.positions_m:
            for (x0, y0), (x1, y1) in solid:
                off_m = math.hypot(max(x0 - place_m[0], 0, place_m[0] - x1), max(y0 - place_m[1], 0, place_m[1] - y1))
                near = min(near, off_m)
    assert 0.5 * (1.0 - 0.02) <= near < 2.0
