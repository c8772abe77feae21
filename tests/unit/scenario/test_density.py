"""Densities that move: where the mean is at each time, each mistake in a path, and the check along the path."""

import math
import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltaswarm_orchestrator.scenarios.load import commented_toml, load_scenario, to_toml
from deltaswarm_scenario import density as density_settings
from deltaswarm_scenario.density import COARSE_SAMPLES, SAMPLES, ComponentSettings, share_inside
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import SettingsError, load
from tests.support.pages import ROOT, files
from tests.support.tiers import in_one_test

WAY: dict[str, Any] = {"path_m": [[10, 50], [90, 50]], "path_s": [0, 100]}
NARROW = {"covariance_m2": [[1, 0], [0, 1]]}
WALL = {"corners_m": [[40, 0], [60, 0], [60, 100], [40, 100]]}


def mistakes(density: Any, obstacles: tuple[Any, ...] = ()) -> list[tuple[str, str]]:
    """Keys and what was found."""
    table = {"events": {"density": density}, "arena": {"obstacles": list(obstacles)}}
    with pytest.raises(SettingsError) as caught:
        load(Scenario, table)
    assert all(str(problem).startswith(f"{problem.path} must ") for problem in caught.value.problems)
    return [(problem.path, problem.given) for problem in caught.value.problems]


def load_with(density: Any, obstacles: tuple[Any, ...] = ()) -> Scenario:
    return load(Scenario, {"events": {"density": density}, "arena": {"obstacles": list(obstacles)}})


@in_one_test(
    ("time_s", "mean_m"),
    [(0, (1, 2)), (10, (1, 2)), (12.5, (2, 4)), (15, (3, 6)), (20, (9, 9)), (25, (8, 9)), (30, (7, 9)), (1e9, (7, 9))],
)
def test_the_mean_follows_the_path(time_s: float, mean_m: tuple[float, float]) -> None:
    """It waits at the first waypoint, moves evenly, jumps to the last of several at one time, and stays at the end."""
    path = ((1.0, 2.0), (5.0, 10.0), (0.0, 0.0), (9.0, 9.0), (7.0, 9.0))
    part = ComponentSettings(path_m=path, path_s=(10.0, 20.0, 20.0, 20.0, 30.0))
    assert part.mean_at(time_s) == pytest.approx(mean_m)


@given(st.floats(0, 1e8))
def test_without_a_path_the_mean_stays(time_s: float) -> None:
    assert ComponentSettings(mean_m=(3.0, 4.0)).mean_at(time_s) == (3.0, 4.0)
    moved = ComponentSettings(mean_m=(3.0, 4.0), path_m=((8.0, 9.0),), path_s=(5.0,))
    assert moved.mean_at(time_s) == (8.0, 9.0)


def test_a_mean_that_a_path_replaces_may_be_anywhere() -> None:
    density = {"path_m": [[10, 10]], "path_s": [0]}
    assert load(Scenario, {"events": {"density": density}, "arena": {"width_m": 40, "height_m": 40}})


MISTAKES: list[tuple[Any, list[tuple[str, str]]]] = [
    ({"path_m": [[1, 1]]}, [("path_s", "0 for 1 waypoints")]),
    ({"path_s": [1]}, [("path_s", "1 for 0 waypoints")]),
    ({**WAY, "path_s": [0, 1, 2]}, [("path_s", "3 for 2 waypoints")]),
    ({**WAY, "path_s": [7, 5]}, [("path_s[1]", "5")]),
    ({**WAY, "path_s": [-1, 5]}, [("path_s[0]", "-1")]),
    ({**WAY, "path_s": [0, 1e9]}, [("path_s[1]", "1000000000.0")]),
    ({**WAY, "path_s": [0, math.inf]}, [("path_s[1]", "inf")]),
    ({**WAY, "path_s": [0, math.nan]}, [("path_s[1]", "nan")]),
    ({**WAY, "path_s": 5}, [("path_s", "5")]),
    ({**WAY, "path_m": [[10, 50], [math.nan, 50]]}, [("path_m[1][0]", "nan")]),
    ({**WAY, "path_m": [[10, -math.inf], [10, 50]]}, [("path_m[0][1]", "-inf")]),
    ({**WAY, "path_m": [[10, 50], [1, 2, 3]]}, [("path_m[1]", "[1.0, 2.0, 3.0]")]),
    ({**WAY, "path_m": [10, 50]}, [("path_m[0]", "10"), ("path_m[1]", "50")]),
    ({**WAY, "path_m": [[10, 50], [90, 101]]}, [("path_m[1]", "[90.0, 101.0]")]),
    ({**WAY, "path_m": [[-1, 50], [90, 10]]}, [("path_m[0]", "[-1.0, 50.0]")]),
]


@in_one_test(("density", "found"), MISTAKES)
def test_each_mistake_is_a_message_with_its_key(density: Any, found: list[tuple[str, str]]) -> None:
    assert mistakes(density) == [(f"events.density.{path}", value) for path, value in found]
    mixture = {"kind": "mixture", "components": [{}, density]}
    assert mistakes(mixture) == [(f"events.density.components[1].{path}", value) for path, value in found]


@pytest.mark.parametrize("kind", [{"kind": "uniform"}, {"kind": "grid", "file": "a.csv"}, {"kind": "mixture"}])
def test_only_a_normal_distribution_moves(kind: dict[str, Any]) -> None:
    parts = {"components": [{}]} if kind["kind"] == "mixture" else {}
    assert mistakes({**kind, **parts, **WAY}) == [
        ("events.density.path_m", "[[10.0, 50.0], [90.0, 50.0]]"),
        ("events.density.path_s", "[0.0, 100.0]"),
    ]


def test_a_path_through_a_wall_is_refused() -> None:
    [(path, found)] = mistakes({**WAY, **NARROW}, (WALL,))
    assert path == "events.density"
    share, time_s = (float(found.split()[index]) for index in (0, 3))
    assert share < 1e-3
    assert 40 < time_s < 60


@in_one_test(
    ("path_m", "path_s", "is_refused"),
    [
        ([[10, 50], [90, 50]], [50, 50], False),
        ([[10, 50], [10, 50], [90, 50]], [0, 50, 50], False),
        ([[10, 50], [10, 90], [90, 90], [90, 50]], [0, 50, 50, 100], False),
        ([[50, 50]], [1000], True),
        ([[10, 50], [90, 50], [50, 50]], [0, 0, 1000], True),
        ([[50, 50], [90, 50]], [50, 50], True),
        ([[10, 10], [50, 50], [90, 50]], [0, 50, 50], True),
    ],
)
def test_a_path_may_jump_over_a_wall(path_m: Any, path_s: Any, is_refused: bool) -> None:
    density = {"path_m": path_m, "path_s": path_s, **NARROW}
    if is_refused:
        assert [path for path, _ in mistakes(density, (WALL,))] == ["events.density"]
    else:
        assert load_with(density, (WALL,)).events.density.moves


def test_one_component_in_a_wall_leaves_the_others() -> None:
    """A mixture is refused only if all of its components are covered at the same time."""
    through, later = {**WAY, **NARROW}, {**WAY, **NARROW, "path_s": [100, 200]}
    assert load_with({"kind": "mixture", "components": [through, later]}, (WALL,))
    [(path, _)] = mistakes({"kind": "mixture", "components": [through, through]}, (WALL,))
    assert path == "events.density"


def test_a_narrow_gap_is_no_mistake() -> None:
    """A first look at few positions would see none of it; the full one does."""
    walls = tuple({"corners_m": [[0, y], [100, y], [100, y + 49.8], [0, y + 49.8]]} for y in (0, 50.2))
    scenario = load_with({**WAY, "covariance_m2": [[1, 0], [0, 400]]}, walls)
    normals = scenario.events.density.normals_at(50.0)
    assert share_inside(normals, (100.0, 100.0), scenario.arena.obstacles, COARSE_SAMPLES) == 0


def evaluated(density: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> int:
    """Count the positions at which the check evaluates a density."""
    counts = []

    def counting(normals: Any, size_m: Any, obstacles: Any, samples: int = SAMPLES) -> float:
        counts.append(samples)
        return share_inside(normals, size_m, obstacles, samples)

    with monkeypatch.context() as patch:
        patch.setattr(density_settings, "share_inside", counting)
        load_with(density)
    return sum(counts)


def test_the_check_is_cheap(monkeypatch: pytest.MonkeyPatch) -> None:
    """A standing density is evaluated once; a path of 100 waypoints costs at most 8 times as much."""
    density_settings._mass_problems.cache_clear()
    circle = [[50 + 30 * math.cos(i / 16), 50 + 30 * math.sin(i / 16)] for i in range(100)]
    assert evaluated({"mean_m": [31, 41]}, monkeypatch) == SAMPLES
    assert evaluated({"path_m": circle, "path_s": list(range(100))}, monkeypatch) <= 8 * SAMPLES
    assert evaluated({"path_m": [[31, 42]] * 100, "path_s": list(range(100))}, monkeypatch) <= SAMPLES


def test_the_example_of_the_documentation_is_a_scenario() -> None:
    table = tomllib.loads(files((ROOT / "docs" / "SWEEPS.md").read_text())["moving.toml"])
    scenario = load(Scenario, table)
    assert scenario.events.density.path_s == (0.0, 3600.0, 3600.0)
    for text in (to_toml(scenario), commented_toml(scenario)):
        assert load(Scenario, tomllib.loads(text)) == scenario


def test_a_path_can_be_set_on_the_command_line() -> None:
    scenario = load_scenario("smoke", ["events.density.path_m=[[5, 5], [35, 5]]", "events.density.path_s=[0, 60]"])
    assert scenario.events.density.normals_at(30.0)[0][1] == (20.0, 5.0)
