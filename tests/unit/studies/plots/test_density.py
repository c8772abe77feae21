"""The event density as drawn is the density that the world draws events from, for every kind."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from deltaswarm_scenario.density import ComponentSettings, DensitySettings
from deltaswarm_scenario.scenario import ArenaSettings, Scenario
from deltaswarm_studies.plots.density import level_holding, phi
from deltaswarm_world.core.density import Places
from deltaswarm_world.core.obstacles import Obstacles

ARENA = ArenaSettings(80.0, 40.0)
MIXTURE = (
    ComponentSettings(3.0, (20.0, 30.0), ((60.0, 25.0), (25.0, 40.0))),
    ComponentSettings(1.0, (78.0, 5.0), ((90.0, 0.0), (0.0, 30.0))),  # much of it falls outside
)
WAY_M, WAY_S = ((20.0, 30.0), (70.0, 10.0), (10.0, 5.0)), (1000.0, 5000.0, 5000.0)


def scenario(density: DensitySettings, arena: ArenaSettings = ARENA) -> Scenario:
    base = Scenario()
    return dataclasses.replace(base, arena=arena, events=dataclasses.replace(base.events, density=density))


def densities(folder: Path) -> dict[str, DensitySettings]:
    weights = np.array([[0.0, 1.0, 2.0, 5.0], [4.0, 0.0, 3.0, 1.0]])
    np.save(folder / "weights.npy", weights)
    np.savetxt(folder / "weights.csv", weights, delimiter=",")
    return {
        "gaussian": DensitySettings("gaussian", (30.0, 8.0), ((120.0, -20.0), (-20.0, 40.0))),
        "mixture": DensitySettings("mixture", components=MIXTURE),
        "moving": DensitySettings("gaussian", covariance_m2=((60.0, 25.0), (25.0, 40.0)), path_m=WAY_M, path_s=WAY_S),
        "uniform": DensitySettings("uniform"),
        "npy": DensitySettings("grid", file=str(folder / "weights.npy")),
        "csv": DensitySettings("grid", file=str(folder / "weights.csv")),
    }


@pytest.mark.parametrize("kind", ["gaussian", "mixture", "moving", "uniform", "npy", "csv"])
def test_what_is_drawn_is_what_the_world_draws_from(kind: str, tmp_path: Path) -> None:
    """20,000 of the world's draws over a run fall into coarse cells as often as phi says, within 5 standard errors."""
    shown = scenario(densities(tmp_path)[kind])
    field = phi(shown, 160)
    assert field.sum() * ARENA.width_m * ARENA.height_m / 160**2 == pytest.approx(1)
    drawn, rng, count = Places(shown.events.density, ARENA, Obstacles([])), np.random.default_rng(7), 20_000
    places = np.array([drawn.draw(rng, number * shown.run.duration_s / count) for number in range(count)])
    bounds = [(0, ARENA.height_m), (0, ARENA.width_m)]
    seen, _, _ = np.histogram2d(places[:, 1], places[:, 0], bins=8, range=bounds)
    expected = field.reshape(8, 20, 8, 20).sum(axis=(1, 3)) / field.sum()
    error = 5 * np.sqrt(expected * (1 - expected) / count) + 2e-4
    assert (np.abs(seen / count - expected) < error).all()


def test_the_papers_density_holds_95_percent_in_a_circle() -> None:
    """Of radius sqrt(50 x 5.99) = 17.3 m around the centre: what lies above the level has that area."""
    shown = scenario(DensitySettings(), ArenaSettings(100.0, 100.0))
    field = phi(shown, 400)
    level = level_holding(field, 0.95)
    assert level is not None
    area_m2 = np.mean(field >= level) * 100.0**2
    assert area_m2 == pytest.approx(np.pi * 50 * -2 * np.log(0.05), rel=0.01)


def test_a_uniform_density_has_no_such_level() -> None:
    """No line can be drawn around a part of it."""
    assert level_holding(phi(scenario(DensitySettings("uniform")), 50), 0.95) is None
