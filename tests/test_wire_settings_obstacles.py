"""Obstacles in a scenario: each mistake has one clear message, and agents get the same polygons."""

import tomllib
from typing import Any

import pytest

from deltaswarm_orchestrator.run.scenario import load_scenario, to_toml
from deltaswarm_wire.checked import SettingsError, load
from deltaswarm_wire.settings import Scenario

TRIANGLE = {"corners_m": [[1, 1], [9, 1], [5, 9]]}


@pytest.mark.parametrize(
    ("obstacle", "message"),
    [
        ({}, ".corners_m: 0 corners; at least 3 are expected"),
        ({"corners_m": [[1, 1], [2, 2]]}, ".corners_m: 2 corners; at least 3 are expected"),
        ({"corners_m": [[1, 1], [2, 2], [3]]}, ".corners_m[2]: [3.0]; two coordinates [x, y] are expected"),
        (
            {"corners_m": [[1, 1], [2, 2], [3, 3]]},
            ".corners_m: an area of 0 m2; corners that are not on one line are expected: an obstacle has an area",
        ),
        (
            {"corners_m": [[0, 0], [9, 9], [0, 9], [5, 0]]},
            ".corners_m: the edges after corners 0 and 2 meet; corners in order along the edge are expected",
        ),
        (
            {"corners_m": [[0, 0], [9, 0], [9, 0], [5, 5]]},
            ".corners_m: the edges after corners 0 and 1 meet; corners in order along the edge are expected",
        ),
        (
            {"corners_m": [[0, 0], [9, 0], [4, 0], [4, 5]]},
            ".corners_m: the edges after corners 0 and 1 meet; corners in order along the edge are expected",
        ),
        (
            {"corners_m": [[1, 1], [41, 1], [5, 9]]},
            ".corners_m[1]: [41.0, 1.0]; a place within 40 m x 40 m is expected",
        ),
        ({**TRIANGLE, "attenuation_db": -1}, ".attenuation_db: -1; a number at least 0 and at most 1000 is allowed"),
        ({**TRIANGLE, "attenuation": 3}, ".attenuation: unknown key; did you mean 'attenuation_db'?"),
    ],
)
def test_a_mistake_is_one_message(obstacle: dict[str, Any], message: str) -> None:
    """Where, what was found, what is expected."""
    arena = {"width_m": 40, "height_m": 40, "obstacles": [TRIANGLE, obstacle]}
    density = {"mean_m": [20, 20]}
    with pytest.raises(SettingsError) as caught:
        load(Scenario, {"arena": arena, "events": {"density": density}})
    assert str(caught.value) == f"arena.obstacles[1]{message}"


def test_agents_know_the_same_obstacles() -> None:
    """As they know the arena's size; through TOML and back."""
    sets = ["arena.obstacles=[{corners_m=[[1,1],[9,1],[5,9]],attenuation_db=3},{corners_m=[[20,20],[30,20],[30,30]]}]"]
    scenario = load_scenario("smoke", sets)
    assert load(Scenario, tomllib.loads(to_toml(scenario))) == scenario
    assert scenario.for_agent(0).obstacles == scenario.arena.obstacles
    assert [obstacle.attenuation_db for obstacle in scenario.arena.obstacles] == [3.0, None]
