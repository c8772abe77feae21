"""Where events occur: each density gives the places that it promises, all of them in the arena."""

import pickle
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from deltaswarm_scenario.density import DensitySettings
from deltaswarm_scenario.scenario import ArenaSettings, Scenario
from deltaswarm_wire.checked import SettingsError, load
from deltaswarm_wire.obstacles import ObstacleSettings
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.density import DENSEST_EVERY_S, Places, load_grid
from deltaswarm_world.core.environment import Environment
from deltaswarm_world.core.obstacles import Obstacles
from tests.support.tiers import in_one_test

PAPER = [[50.0, 0.0], [0.0, 50.0]]
DRAWS = 4000


def made(density: dict[str, Any], obstacles: Sequence[ObstacleSettings] = (), **arena: float) -> Places:
    return Places(load(DensitySettings, density), ArenaSettings(**arena), Obstacles(obstacles))


def places(
    density: dict[str, Any],
    draws: int = DRAWS,
    seed: int = 7,
    obstacles: Sequence[ObstacleSettings] = (),
    time_s: float = 0.0,
    **arena: float,
) -> Floats:
    """Many draws at one time, (n, 2) [m]."""
    found = made(density, obstacles, **arena)
    rng = np.random.default_rng(seed)
    return np.array([found.draw(rng, time_s) for _ in range(draws)])


def are_inside(found: Floats, width_m: float = 100.0, height_m: float = 100.0) -> bool:
    return bool(np.all(found >= 0) and np.all(found <= (width_m, height_m)))


def a_component(weight: float, x_m: float, y_m: float) -> dict[str, Any]:
    return {"weight": weight, "mean_m": [x_m, y_m], "covariance_m2": [[4, 0], [0, 4]]}


@pytest.mark.parametrize("covariance", [PAPER, [[40.0, 25.0], [25.0, 60.0]], [[9.0, -8.0], [-8.0, 16.0]]])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_gaussian_has_its_mean_and_covariance(covariance: list[list[float]], seed: int) -> None:
    """The paper's density, and ones that are correlated: moments of 4,000 draws within 4 standard errors or so."""
    found = places({"mean_m": [48, 52], "covariance_m2": covariance}, seed=seed)
    assert are_inside(found)
    assert np.allclose(found.mean(axis=0), [48, 52], atol=0.5)
    assert np.allclose(np.cov(found.T), covariance, rtol=0.1, atol=2.5)


def test_what_falls_outside_is_drawn_again() -> None:
    """A mean in the corner: a quarter of the normal distribution, no heap of events at the walls."""
    found = places({"mean_m": [0, 0], "covariance_m2": PAPER})
    assert are_inside(found)
    assert not np.any(found == 0)
    assert np.allclose(found.mean(axis=0), (2 * 50 / np.pi) ** 0.5, atol=0.4)


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0.01, 1e4), st.floats(0.01, 1e4), st.floats(-0.99, 0.99))
def test_everything_is_in_the_arena(right: float, up: float, xx: float, yy: float, correlation: float) -> None:
    xy = correlation * (xx * yy) ** 0.5
    density = {"mean_m": [40 * right, 25 * up], "covariance_m2": [[xx, xy], [xy, yy]]}
    assert are_inside(places(density, 20, width_m=40.0, height_m=25.0), 40.0, 25.0)


def test_a_density_outside_the_arena_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """With an error that names the key, instead of drawing for ever."""
    monkeypatch.setattr("deltaswarm_world.core.density.MAX_BATCHES", 5)
    with pytest.raises(ValueError, match=r"events\.density must"):
        places({"mean_m": [5000, 5000], "covariance_m2": PAPER}, 1)


@pytest.mark.parametrize("covariance", [[[1e7, 0], [0, 1e7]], [[4e6, 0], [0, 900]], [[900, 0], [0, 4e6]]])
def test_a_density_with_little_mass_inside_is_the_truncated_one(covariance: list[list[float]]) -> None:
    """Along each axis: uniform if the density is much wider than the arena there, else the truncated normal."""
    found = places({"mean_m": [50, 50], "covariance_m2": covariance})
    assert are_inside(found)
    for axis in (0, 1):
        spread = covariance[axis][axis] ** 0.5
        cut = stats.truncnorm(-50 / spread, 50 / spread, 50, spread)
        assert stats.kstest(found[:, axis], cut.cdf).pvalue > 0.001


def test_obstacles_truncate_a_density() -> None:
    """No event in them, and as many to either side of them as there would be without."""
    wall = ObstacleSettings(((45.0, 0.0), (60.0, 0.0), (60.0, 100.0), (45.0, 100.0)))
    found = places({"mean_m": [50, 50], "covariance_m2": PAPER}, obstacles=[wall])
    assert not np.any((found[:, 0] > 45) & (found[:, 0] < 60))
    left, right = stats.norm(50, 50**0.5).cdf(45), stats.norm(50, 50**0.5).sf(60)
    assert np.mean(found[:, 0] < 50) == pytest.approx(left / (left + right), abs=0.02)


@in_one_test(
    ("density", "obstacles", "densest_m"),
    [
        ({"mean_m": [48, 52], "covariance_m2": PAPER}, [], (48, 52)),
        ({"kind": "uniform"}, [], None),
        ({"kind": "mixture", "components": [a_component(1, 20, 20), a_component(2, 80, 30)]}, [], (80, 30)),
        (
            {"mean_m": [48, 52], "covariance_m2": PAPER},
            [ObstacleSettings(((0.0, 40.0), (100.0, 40.0), (100.0, 55.0), (0.0, 55.0)))],
            (48, 55),
        ),
    ],
)
def test_the_densest_position(
    density: dict[str, Any], obstacles: list[ObstacleSettings], densest_m: tuple[float, float] | None
) -> None:
    """A free one, within the mesh's 1 m; none where events are equally dense everywhere."""
    found = made(density, obstacles).densest_m(0.0)
    assert (found is None) == (densest_m is None)
    if found is not None and densest_m is not None:
        assert found == pytest.approx(densest_m, abs=1.0)


def test_a_mixture_has_its_shares() -> None:
    """Each component as many events as its weight says, around its own mean."""
    parts = [a_component(1, 20, 20), a_component(2, 80, 30), a_component(5, 40, 80)]
    found = places({"kind": "mixture", "components": parts})
    assert are_inside(found)
    means = np.array([part["mean_m"] for part in parts])
    nearest = np.argmin(np.linalg.norm(found[:, None] - means, axis=2), axis=1)
    assert np.allclose(np.bincount(nearest) / DRAWS, [1 / 8, 2 / 8, 5 / 8], atol=0.03)
    for part, mean in enumerate(means):
        assert np.allclose(found[nearest == part].mean(axis=0), mean, atol=0.4)
        assert np.allclose(np.cov(found[nearest == part].T), 4 * np.eye(2), atol=0.8)


def test_a_uniform_density_is_even() -> None:
    found = places({"kind": "uniform"}, width_m=80.0, height_m=20.0)
    assert are_inside(found, 80.0, 20.0)
    fields = np.floor(found / [20, 10]).astype(int)
    assert np.allclose(np.bincount(fields[:, 0] + 4 * fields[:, 1]) / DRAWS, 1 / 8, atol=0.025)


PATH: dict[str, Any] = {"path_m": [[20, 30], [80, 30], [80, 70], [40, 20]], "path_s": [100, 200, 200, 400]}
"""Two straight ways with a jump between them."""
MOVING_MIXTURE = {"kind": "mixture", "components": [{**a_component(1, 90, 90), **PATH}, a_component(2, 50, 90)]}
KEPT = {"path_m": [[48, 52]] * 3, "path_s": [0, 50, 50]}
"""A path that stays where it is."""


@in_one_test(
    ("time_s", "mean_m"),
    [(0, (20, 30)), (100, (20, 30)), (125, (35, 30)), (199.9, (79.94, 30)), (200, (80, 70)), (300, (60, 45))],
)
def test_events_follow_the_path(time_s: float, mean_m: tuple[float, float]) -> None:
    """The mean of 4,000 draws at a time is where the path is; at the time of a jump that is after it."""
    found = places({"covariance_m2": [[9, 0], [0, 9]], **PATH}, time_s=time_s)
    assert np.allclose(found.mean(axis=0), mean_m, atol=0.25)
    assert np.allclose(np.cov(found.T), 9 * np.eye(2), atol=0.8)


@given(
    path=st.lists(st.tuples(st.floats(0, 40), st.floats(0, 25), st.floats(0, 100)), min_size=1, max_size=6),
    time_s=st.floats(0, 120),
    variance=st.sampled_from([1e-4, 30.0, 1e5]),
)
def test_at_each_time_it_is_a_density_that_stands(
    path: list[tuple[float, float, float]], time_s: float, variance: float
) -> None:
    """Narrow or much wider than the arena: the draws are those of the same density with the mean of that time."""
    times_s = sorted({place[2] for place in path})
    way_m = np.array([place[:2] for place in path])[: len(times_s)]
    mean_m = [float(np.interp(time_s, times_s, axis)) for axis in way_m.T]
    base = {"covariance_m2": [[variance, 0], [0, variance]]}
    moving = {**base, "path_m": way_m.tolist(), "path_s": times_s}
    found = places(moving, 20, time_s=time_s, width_m=40.0, height_m=25.0)
    assert np.allclose(found, places({**base, "mean_m": mean_m}, 20, width_m=40.0, height_m=25.0), atol=1e-6)


@pytest.mark.parametrize("variance", [50.0, 1e6])
@pytest.mark.parametrize("time_s", [0.0, 20.0, 50.0, 1e6])
def test_a_path_that_stays_changes_no_draw(variance: float, time_s: float) -> None:
    """To the last bit, of a gaussian and of a mixture; nor does it change the densest place."""
    base = {"mean_m": [48, 52], "covariance_m2": [[variance, 0], [0, variance]]}
    wall = [ObstacleSettings(((0.0, 40.0), (100.0, 40.0), (100.0, 55.0), (0.0, 55.0)))]
    other = a_component(2, 80, 30)
    for stands, moves in (
        (base, {**base, **KEPT}),
        (
            {"kind": "mixture", "components": [base, other]},
            {"kind": "mixture", "components": [{**base, **KEPT}, other]},
        ),
    ):
        assert np.array_equal(places(moves, 200, time_s=time_s), places(stands, 200))
        for obstacles in ([], wall):
            assert made(moves, obstacles).densest_m(time_s) == made(stands, obstacles).densest_m(0.0)


@pytest.mark.parametrize("density", [PATH, MOVING_MIXTURE], ids=["gaussian", "mixture"])
@given(times_s=st.lists(st.floats(0, 500), min_size=1, max_size=6))
def test_the_densest_position_depends_on_the_time_alone(density: dict[str, Any], times_s: list[float]) -> None:
    """Not on what was asked before, nor on a checkpoint in between; it is that of the last multiple of 10 s."""
    asked = made(density)
    for time_s in times_s:
        found = asked.densest_m(time_s)
        assert found == made(density).densest_m(time_s // DENSEST_EVERY_S * DENSEST_EVERY_S)
        assert found == pickle.loads(pickle.dumps(asked)).densest_m(time_s)


def test_the_densest_position_follows_the_path() -> None:
    """It is the mean, and where an obstacle covers that, the nearest free place (within the mesh's 1 m)."""
    wall = [ObstacleSettings(((60.0, 0.0), (100.0, 0.0), (100.0, 50.0), (60.0, 50.0)))]
    for time_s, free_m, blocked_m in ((120, (32, 30), (32, 30)), (180, (68, 30), (60, 30)), (200, (80, 70), (80, 70))):
        assert made(PATH).densest_m(time_s) == pytest.approx(free_m)
        assert made(PATH, wall).densest_m(time_s) == pytest.approx(blocked_m, abs=1.0)


def test_a_world_with_a_moving_density_goes_on_from_its_checkpoint() -> None:
    """The same arrivals and the same densest positions, wherever it was saved."""
    density = {"covariance_m2": [[9, 0], [0, 9]], **PATH}
    table = {"events": {"density": density, "rate_hz": 0.5}, "agents": {"count": 3}}
    straight = Environment(load(Scenario, table))
    saved = Environment(load(Scenario, table))
    for step in range(300):
        straight.arrive(step)
        saved.arrive(step)
        assert saved.density.densest_m(step) == straight.density.densest_m(step)
        if step % 37 == 0:
            saved = pickle.loads(pickle.dumps(saved))
    assert saved.states() == straight.states()
    assert len(saved.arrived) > 100


GRID = np.array([[1.0, 0.0, 2.0], [0.0, 4.0, 1.0]])
"""Two rows from y = 0 upwards, three columns from x = 0."""


def written(folder: Path, name: str, grid: Floats = GRID) -> str:
    file = folder / name
    if name.endswith(".npy"):
        np.save(file, grid)
    else:
        np.savetxt(file, grid, delimiter=",")
    return str(file)


@pytest.mark.parametrize("name", ["weights.npy", "weights.csv"])
def test_a_grids_rows_go_up_and_its_columns_right(tmp_path: Path, name: str) -> None:
    """Each cell has its share, evenly within it, and an empty cell has nothing."""
    found = places({"kind": "grid", "file": written(tmp_path, name)}, width_m=90.0, height_m=40.0)
    assert are_inside(found, 90.0, 40.0)
    cells = np.minimum(np.floor(found / [30, 20]).astype(int), [2, 1])
    counts = np.bincount(cells[:, 1] * 3 + cells[:, 0], minlength=6).reshape(2, 3)
    assert np.allclose(counts / DRAWS, GRID / 8, atol=0.03)
    assert np.all((counts == 0) == (GRID == 0))
    grid = made({"kind": "grid", "file": written(tmp_path, name)}, width_m=90.0, height_m=40.0)
    assert grid.densest_m(0.0) == (45, 30)
    within = found[(cells == [1, 1]).all(axis=1)]
    assert np.allclose(within.mean(axis=0), [45, 30], atol=1.0)


@pytest.mark.parametrize("name", ["weights.npy", "weights.csv"])
def test_a_single_row_is_a_grid(tmp_path: Path, name: str) -> None:
    assert load_grid(written(tmp_path, name, np.array([[1.0, 2.0, 3.0]]))).shape == (1, 3)


@pytest.mark.parametrize(
    "grid",
    [
        [[1.0, -1.0]],
        [[0.0, 0.0]],
        [[1.0, float("nan")]],
        [[1.0, float("inf")]],
        [[1e308, 1e308]],
        np.ones((2, 2, 2)),
        np.ones((0, 2)),
        [["a", "b"]],
        np.zeros(2, dtype=[("a", int), ("b", float)]),
    ],
    ids=["negative", "zero", "nan", "inf", "sum", "cube", "empty", "text", "records"],
)
@pytest.mark.filterwarnings("ignore:overflow")
def test_weights_that_make_no_density_are_refused(tmp_path: Path, grid: Any) -> None:
    with pytest.raises(SettingsError) as caught:
        load_grid(written(tmp_path, "weights.npy", np.array(grid)))
    (problem,) = caught.value.problems
    assert problem.path == "events.density.file"
    assert "weights.npy" in problem.given


@pytest.mark.parametrize(
    "name", ["empty.npy", "junk.npy", "empty.csv", "words.csv", "ragged.csv", "bytes.csv", "nowhere.csv"]
)
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_a_file_that_holds_no_table_is_refused(tmp_path: Path, name: str) -> None:
    """By the key and its name, whatever is in it, and if there is none."""
    content = {"junk": b"no array", "words": b"a,b\n", "ragged": b"1,2\n3\n", "bytes": b"\xff\xfe\x80"}
    if name != "nowhere.csv":
        (tmp_path / name).write_bytes(content.get(name.split(".")[0], b""))
    with pytest.raises(SettingsError, match=rf"events\.density\.file.*{re.escape(name)}"):
        load_grid(str(tmp_path / name))
