"""Wrong options of `world.dynamics = "physics"` are told before a run, one line each."""

import orjson
import pytest

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import page_hello
from deltaswarm_orchestrator.live.views import hello
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_wire.checked import SettingsError
from tests.support.tiers import in_one_test

PHYSICS = 'world.dynamics="physics"'
UNIFORM = ["events.density.kind=uniform"]
NARROW = "arena.obstacles=[{corners_m=[[10,0],[100,0],[100,100],[10,100]]}]"
"""Leaves a tenth of the arena free."""


@in_one_test(
    ("overrides", "line"),
    [
        (
            ["world.radius_m=3.5"],
            "world.radius_m must be at most half of the least distance between members of a tree, 3 m",
        ),
        (
            ["control.d_min_m=0.4"],
            "world.radius_m must be at most half of the least distance between members of a tree",
        ),
        (["world.radius_m=2.9", "agents.count=200"], "world.radius_m must leave room"),
        (["arena.height_m=6", "world.radius_m=3", "agents.count=1", *UNIFORM], "world.radius_m must be less than half"),
        (["control.mode=potential", "world.radius_m=2.9", NARROW, *UNIFORM], "world.radius_m must leave room"),
        (["world.substeps=10"], "world.substeps must be at least 20"),
        (["world.substeps=20", "agents.speed_mps=5"], "world.substeps must be at least 80"),
        (["run.step_s=60", "world.radius_m=0.01", "agents.speed_mps=100"], "world.substeps must be at most 10000"),
        (
            ["agents.count=2", "world.starts_m=[[10,10],[10.4,10]]"],
            "world.starts_m[1] must be at least two radii, 0.5 m",
        ),
        (
            ["agents.count=1", "world.starts_m=[[0.2,10]]"],
            "world.starts_m[0] must be at least a radius, 0.25 m, from the",
        ),
        (["agents.count=3", "world.starts_m=[[10,10]]"], "world.starts_m must be one position per agent, 3"),
        (["agents.count=1", "world.starts_m=[[10]]"], "world.starts_m[0] must be two coordinates"),
        (
            [
                "agents.count=1",
                "world.starts_m=[[39.9,50]]",
                "arena.obstacles=[{corners_m=[[40,40],[60,40],[60,60],[40,60]]}]",
            ],
            "world.starts_m[0] must be at least a radius, 0.25 m, outside arena.obstacles[0]",
        ),
        (["world.wheel_base_m=0.6"], "world.wheel_base_m must be at most the diameter, 0.5 m"),
        (["world.radus_m=1"], "did you mean 'radius_m'"),
        (["world.drive=tracks"], "world.drive must be one of differential, holonomic"),
        (
            ["world.drive=holonomic", 'fault=[{kind="wheel-lost",at_s=1,agents=[0]}]'],
            "world.drive must be differential with the fault wheel-lost",
        ),
        (['run.bound="density"'], "run.bound must be none"),
        (['world.dynamics="point"', 'fault=[{kind="wheel-lost",at_s=1,agents=[0]}]'], "must go with world.dynamics"),
        (['world.dynamics="point"', "world.radius_m=1"], "world.radius_m: unknown key"),
        (["world.dynamics=phisics"], "did you mean 'physics'"),
    ],
)
def test_a_mistake_is_one_line(overrides: list[str], line: str) -> None:
    with pytest.raises(SettingsError) as caught:
        load_scenario("paper-25", [PHYSICS, *overrides])
    assert line in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1, str(caught.value)


@in_one_test("mode", ["decentralised", "potential", "deltaswarm_agent.controllers.potential:PotentialController"])
def test_without_trees_robots_may_be_larger_than_the_distance_of_members(mode: str) -> None:
    keys = [PHYSICS, "world.radius_m=3.5", f"control.mode={mode}", "agents.count=10", *UNIFORM]
    assert load_scenario("paper-25", keys).world.radius_m == 3.5


def test_agents_operator_and_pages_are_told_the_radius_of_a_body() -> None:
    for overrides, radius_m in (([], 0.0), ([PHYSICS], 0.25), ([PHYSICS, "world.radius_m=1"], 1.0)):
        scenario = load_scenario("paper-25", overrides)
        assert scenario.for_agent(0).radius_m == radius_m
        assert page_hello(Console(scenario.for_operator((), 1.0)), "run")["radius_m"] == radius_m
        assert orjson.loads(hello("run", scenario))["radius_m"] == radius_m
