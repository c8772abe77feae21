"""Where events occur: the paper's density phi(x, y), as samplers of positions in the arena."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.settings import ArenaSettings, DensitySettings

Floats = npt.NDArray[np.float64]
Sampler = Callable[[np.random.Generator], tuple[float, float]]
"""Draws a position; pickle must be able to save it in a world's checkpoint."""

MAX_TRIES = 10_000
"""After this many draws in a row outside the arena, the density counts as outside it."""


def sampler(density: DensitySettings, arena: ArenaSettings) -> Sampler:
    """Make a function that draws one position (x_m, y_m) in the arena.

    Raises:
        SettingsError: a grid file that cannot be read or holds no weights.
    """
    if density.kind == "uniform":
        return partial(_draw_uniform, arena)
    if density.kind == "grid":
        return _grid(load_grid(density.file), arena)
    if density.kind == "mixture":
        parts = [(c.weight, c.mean_m, c.covariance_m2) for c in density.components]
    else:
        parts = [(1.0, density.mean_m, density.covariance_m2)]
    return _mixture(parts, arena)


def _draw_uniform(arena: ArenaSettings, rng: np.random.Generator) -> tuple[float, float]:
    return rng.uniform(0.0, arena.width_m), rng.uniform(0.0, arena.height_m)


def _mixture(
    parts: list[tuple[float, tuple[float, ...], tuple[tuple[float, ...], ...]]], arena: ArenaSettings
) -> Sampler:
    weights = np.array([weight for weight, _, _ in parts])
    shares = np.cumsum(weights / weights.sum())
    means = [mean for _, mean, _ in parts]
    factors = [np.linalg.cholesky(np.array(covariance)) for _, _, covariance in parts]
    return partial(_draw_of_mixture, shares, means, factors, arena)


def _draw_of_mixture(
    shares: Floats,
    means: list[tuple[float, ...]],
    factors: list[Floats],
    arena: ArenaSettings,
    rng: np.random.Generator,
) -> tuple[float, float]:
    for _ in range(MAX_TRIES):
        part = min(int(np.searchsorted(shares, rng.random())), len(means) - 1) if len(means) > 1 else 0
        offset = factors[part] @ rng.standard_normal(2)
        x_m, y_m = means[part][0] + float(offset[0]), means[part][1] + float(offset[1])
        if 0.0 <= x_m <= arena.width_m and 0.0 <= y_m <= arena.height_m:
            return x_m, y_m
    raise ValueError(f"events.density must reach into the arena (got {MAX_TRIES} draws in a row outside)")


def load_grid(file: str) -> Floats:
    """The weights of a grid, rows from y = 0 upwards, columns from x = 0.

    Raises:
        SettingsError: the file cannot be read, or is no table of weights >= 0 with a positive sum.
    """
    try:
        is_array = file.endswith(".npy")  # read as such only: np.load would take zips for arrays too
        raw = np.lib.format.open_memmap(file, mode="r") if is_array else np.loadtxt(Path(file), delimiter=",")
        grid = np.atleast_2d(np.array(raw, dtype=np.float64))
    except (OSError, ValueError, TypeError) as error:
        raise SettingsError([Problem("events.density.file", repr(file), f"must be readable: {error}")]) from None
    if grid.ndim != 2 or not np.all(np.isfinite(grid)) or np.any(grid < 0) or not 0 < grid.sum() < np.inf:
        allowed = "must be a table of finite weights >= 0 with a positive sum"
        raise SettingsError([Problem("events.density.file", repr(file), allowed)])
    return grid


def _grid(grid: Floats, arena: ArenaSettings) -> Sampler:
    shares = np.cumsum(grid.ravel() / grid.sum())
    return partial(_draw_of_grid, shares, grid.shape, arena)


def _draw_of_grid(
    shares: Floats, shape: tuple[int, int], arena: ArenaSettings, rng: np.random.Generator
) -> tuple[float, float]:
    rows, columns = shape
    cell = min(int(np.searchsorted(shares, rng.random(), side="right")), rows * columns - 1)
    row, column = divmod(cell, columns)
    x_m = (column + rng.random()) * arena.width_m / columns
    y_m = (row + rng.random()) * arena.height_m / rows
    return x_m, y_m
