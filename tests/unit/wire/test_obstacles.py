"""Obstacles in a scenario: each mistake has one clear message, and agents get the same polygons."""

import tomllib
from typing import Any

from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import load
from tests.support.complaints import mistakes
from tests.support.tiers import in_one_test

TRIANGLE = {"corners_m": [[1, 1], [9, 1], [5, 9]]}


@in_one_test(
    ("obstacle", "said"),
    [
        ({}, (".corners_m", "0")),
        ({"corners_m": [[1, 1], [2, 2]]}, (".corners_m", "2")),
        ({"corners_m": [[1, 1], [2, 2], [3]]}, (".corners_m[2]", "[3.0]")),
        ({"corners_m": [[1, 1], [2, 2], [3, 3]]}, (".corners_m", "0 m2")),
        ({"corners_m": [[0, 0], [9, 9], [0, 9], [5, 0]]}, (".corners_m", "edges that meet after corners 0 and 2")),
        ({"corners_m": [[0, 0], [9, 0], [9, 0], [5, 5]]}, (".corners_m", "edges that meet after corners 0 and 1")),
        ({"corners_m": [[0, 0], [9, 0], [4, 0], [4, 5]]}, (".corners_m", "edges that meet after corners 0 and 1")),
        ({"corners_m": [[1, 1], [41, 1], [5, 9]]}, (".corners_m[1]", "[41.0, 1.0]")),
        ({**TRIANGLE, "attenuation_db": -1}, (".attenuation_db", "-1")),
        ({**TRIANGLE, "attenuation": 3}, (".attenuation", "unknown key")),
    ],
)
def test_a_mistake_is_one_message(obstacle: dict[str, Any], said: tuple[str, str]) -> None:
    arena = {"width_m": 40, "height_m": 40, "obstacles": [TRIANGLE, obstacle]}
    found = mistakes({"arena": arena, "events": {"density": {"mean_m": [20, 20]}}})
    assert found == [(f"arena.obstacles[1]{said[0]}", said[1])]


def test_agents_know_the_same_obstacles() -> None:
    sets = ["arena.obstacles=[{corners_m=[[1,1],[9,1],[5,9]],attenuation_db=3},{corners_m=[[20,20],[30,20],[30,30]]}]"]
    scenario = load_scenario("smoke", sets)
    assert load(Scenario, tomllib.loads(to_toml(scenario))) == scenario
    assert scenario.for_agent(0).obstacles == scenario.arena.obstacles
    assert [obstacle.attenuation_db for obstacle in scenario.arena.obstacles] == [3.0, None]
