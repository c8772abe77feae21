"""The paper's event density phi(x, y) as a field to draw, for every kind that a scenario may name."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import stats

from deltaswarm_wire.settings import Scenario

Floats = npt.NDArray[np.float64]

CELLS = 200
"""Cells along each side of the arena."""


def phi(scenario: Scenario, cells: int = CELLS) -> Floats:
    """Return the density of events (cells, cells) [1/m2] at the cells' centres, rows from y = 0, columns from x = 0.

    Its integral over the arena is 1, because an event outside the arena is drawn again. A grid is read from its file.

    Raises:
        OSError: the grid's file cannot be read.
        ValueError: the grid's file holds no table of weights.
    """
    arena, density = scenario.arena, scenario.events.density
    shares = (np.arange(cells) + 0.5) / cells
    if density.kind == "uniform":
        found = np.ones((cells, cells))
    elif density.kind == "grid":
        weights = _weights(density.file)
        rows, columns = ((shares * side).astype(int) for side in weights.shape)
        found = weights[np.ix_(rows, columns)]
    else:
        places_m = np.stack(np.meshgrid(shares * arena.width_m, shares * arena.height_m), axis=-1)
        parts = [(1.0, density.mean_m, density.covariance_m2)]
        if density.kind == "mixture":
            parts = [(part.weight, part.mean_m, part.covariance_m2) for part in density.components]
        found = np.zeros((cells, cells))
        for weight, mean_m, covariance_m2 in parts:
            found += weight * stats.multivariate_normal(mean_m, covariance_m2).pdf(places_m)
    normed: Floats = found / (found.sum() * arena.width_m * arena.height_m / cells**2)
    return normed


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
