"""Quadcopters follow velocities, hold their heights against wind, repeat to the bit, and fail when they crash."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deltaswarm_branches.parent import read_parent
from deltaswarm_cluster.engine import Dask
from deltaswarm_orchestrator.base.exits import CommandError, Reporter
from deltaswarm_orchestrator.export.snapshots import read_film
from deltaswarm_orchestrator.processes.boards import Boards
from deltaswarm_orchestrator.recording.reader import recording_in
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.run.lifecycle import run
from deltaswarm_orchestrator.run.options import RunOptions, check
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import SettingsError
from deltaswarm_world.core.environment import Environment
from tests.support.tiers import in_one_test

JSBSIM = 'world.dynamics="jsbsim"'


def world(*overrides: str) -> Environment:
    return Environment(load_scenario("paper-25", [JSBSIM, "agents.count=2", *overrides], 5))


@in_one_test(("wind",), [([],), (["world.wind_mps=5", "world.gust_mps=1"],)])
def test_a_quadcopter_follows_a_velocity_and_holds_its_height(wind: list[str]) -> None:
    environment = world("world.heights_m=[5,20]", *wind)
    for _ in range(8):
        environment.command(0, 0.0, 0.0)
        environment.command(1, 0.6, -0.8)
        before = environment.positions_m.copy()
        environment.move()
    moved = environment.positions_m - before
    assert moved[0].tolist() == pytest.approx([0.0, 0.0], abs=0.1)
    assert moved[1].tolist() == pytest.approx([0.6, -0.8], abs=0.1)
    assert [state.height_m for state in environment.dynamics.states() or ()] == pytest.approx([5.0, 20.0], abs=0.1)


def test_a_crash_is_a_failure_with_its_cause() -> None:
    fault = 'fault=[{kind="rotor-lost",at_s=3,agents=[1]}]'
    run = InProcess(load_scenario("paper-25", [JSBSIM, "agents.count=3", "run.duration_s=12", fault], 5))
    list(run.steps())
    run.finish(0.0)
    [failed] = run.outcome.world["agents_failed"]
    assert failed["agent"] == 1
    assert failed["cause"].startswith("crashed: tumbled")
    assert failed["steps"] > 0


def test_two_runs_have_the_same_digest() -> None:
    digests = []
    for _ in range(2):
        wind = ["world.wind_mps=5", "world.gust_mps=2"]
        run = InProcess(load_scenario("paper-25", [JSBSIM, "agents.count=4", "run.duration_s=10", *wind], 5))
        list(run.steps())
        digests.append((run.world.digest.hex(), run.world.environment.positions_m.tolist()))
    assert digests[0] == digests[1]


def started(scenario: Scenario, out: Path, **options: Any) -> None:
    check(scenario, RunOptions(out=out, **options))


ATTEMPTS: dict[str, Callable[[Scenario, Path], object]] = {
    "saved with --checkpoint": lambda scenario, out: started(scenario, out, checkpoint_steps=5),
    "some of which are on boards": lambda scenario, out: started(
        scenario, out, boards=Boards((0,), "tcp/192.0.2.1:7447", out / "boards")
    ),
    "which are on other machines": lambda scenario, out: started(
        scenario, out, engine=Dask("tcp://192.0.2.1:8786", "")
    ),
    "RUN must have bodies that can be saved": lambda scenario, out: read_parent(
        run(scenario, RunOptions(out=out, in_process=True), Reporter()).folder
    ),
    "cannot be saved": lambda scenario, out: pickle.dumps(Environment(scenario).dynamics),
}


@in_one_test("words", ATTEMPTS)
def test_what_quadcopters_cannot_do_is_refused_by_name(words: str, tmp_path: Path) -> None:
    scenario = load_scenario("smoke", [JSBSIM, "run.duration_s=3"])
    with pytest.raises((CommandError, SettingsError, TypeError)) as told:
        ATTEMPTS[words](scenario, tmp_path / "run")
    for told_of in (words, "world.dynamics", "jsbsim"):
        assert told_of in str(told.value)


@in_one_test(
    ("override", "line"),
    [
        ("agents.speed_mps=4", "agents.speed_mps of at most 3 m/s"),
        ("world.radius_m=50", "world.radius_m must be less than half"),
        ("world.heights_m=[10,0.1]", "world.heights_m[1] must be from 0.3 to 1000 m"),
        ("world.heights_m=[]", "world.heights_m must have at least one height"),
    ],
)
def test_bad_settings_are_told(override: str, line: str) -> None:
    with pytest.raises(SettingsError) as told:
        load_scenario("paper-25", [JSBSIM, override])
    assert line in str(told.value)


def test_a_run_of_quadcopters_is_recorded_with_their_heights(tmp_path: Path) -> None:
    scenario = load_scenario("smoke", [JSBSIM, "run.duration_s=5", "world.heights_m=[5,20]"])
    result = run(scenario, RunOptions(out=tmp_path / "run", in_process=True), Reporter())
    assert result.summary["valid"], result.messages
    *_, view = read_film(recording_in(result.folder)).snapshots()
    heights_m = [[5.0, 20.0][body.agent % 2] for body in view.bodies]
    assert [body.height_m for body in view.bodies] == pytest.approx(heights_m, abs=0.2)
    assert all(body.heading_rad is not None for body in view.bodies)
