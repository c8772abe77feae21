"""The paper's event density phi(x, y) as a field to draw, for every kind that a scenario may name."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import stats

from deltaswarm_scenario.density import Component
from deltaswarm_scenario.scenario import Scenario

Floats = npt.NDArray[np.float64]

CELLS = 200
"""Cells along each side of the arena."""

MOMENTS = 100
"""Number of times in a run over which a density that moves is averaged."""


def phi(scenario: Scenario, cells: int = CELLS) -> Floats:
    """Return the density of events (cells, cells) [1/m2] at the cells' centres, rows from y = 0, columns from x = 0.

    For a density that moves, this is the mean over the run. Its integral over the arena is 1, because an event outside
    the arena is drawn again. A grid is read from its file.

    Raises:
        OSError: the grid's file cannot be read.
        ValueError: the grid's file holds no table of weights.
    """
    arena, density = scenario.arena, scenario.events.density
    shares = (np.arange(cells) + 0.5) / cells
    if density.kind == "uniform":
        fields = [np.ones((cells, cells))]
    elif density.kind == "grid":
        weights = _weights(density.file)
        rows, columns = ((shares * side).astype(int) for side in weights.shape)
        fields = [weights[np.ix_(rows, columns)]]
    else:
        places_m = np.stack(np.meshgrid(shares * arena.width_m, shares * arena.height_m), axis=-1)
        moments = MOMENTS if density.moves else 1
        times_s = (np.arange(moments) + 0.5) / moments * scenario.run.duration_s
        fields = [_mixture(density.normals_at(float(time_s)), places_m) for time_s in times_s]
    mean: Floats = np.mean([field / field.sum() for field in fields], axis=0)
    return mean * cells**2 / (arena.width_m * arena.height_m)


def _mixture(normals: Sequence[Component], places_m: Floats) -> Floats:
    field: Floats = np.zeros(places_m.shape[:-1])
    for weight, mean_m, covariance_m2 in normals:
        field += weight * stats.multivariate_normal(mean_m, covariance_m2).pdf(places_m)
    return field


def level_holding(field: Floats, share: float) -> float | None:
    """Return the level above which a density (rows, columns) holds this share of all events; None if it is uniform.

    The paper speaks of the area in which 95 % of the events occur.
    """
    if np.ptp(field) <= 1e-9 * field.max():
        return None
    falling = np.sort(field, axis=None)[::-1]
    held = np.cumsum(falling) / falling.sum()
    return float(falling[np.searchsorted(held, share)])


def _weights(file: str) -> Floats:
    if file.endswith(".npy"):  # not by np.load, which would also accept zip files
        return np.atleast_2d(np.array(np.lib.format.open_memmap(file, mode="r"), dtype=np.float64))
    return np.loadtxt(Path(file), delimiter=",", ndmin=2)
