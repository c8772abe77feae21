"""Where events occur: positions drawn from the paper's density phi(x, y)."""

from copy import copy

import numpy as np

from deltaswarm_scenario.density import Component, DensitySettings
from deltaswarm_scenario.grid import read_grid
from deltaswarm_scenario.scenario import ArenaSettings
from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_world.core.arrays import Floats, Mask
from deltaswarm_world.core.obstacles import Obstacles

MAX_BATCH = 4096
MAX_BATCHES = 3000
"""12 million draws: enough for every density that the scenario's check lets pass (`settings_density.MIN_SHARE`)."""

DENSEST_EVERY_S = 10.0
"""The densest position of a density that moves is found anew at multiples of this time."""

MESH = 100
"""Positions along each side of the arena among which the densest is looked for."""


class Uniform:
    def __init__(self, size_m: Floats) -> None:
        self.centres_m: Floats = np.zeros((0, 2))
        self._size_m = size_m

    def propose(self, rng: np.random.Generator, count: int) -> Floats:
        places_m: Floats = rng.random((count, 2)) * self._size_m
        return places_m

    def at(self, places_m: Floats) -> Floats:
        return np.ones(len(places_m))


class Normals:
    def __init__(self, parts: list[Component], size_m: Floats) -> None:
        weights = np.array([weight for weight, _, _ in parts])
        covariances = np.array([covariance for _, _, covariance in parts])
        self.centres_m: Floats = np.array([mean for _, mean, _ in parts])
        self._shares = np.cumsum(weights)
        self._factors_m = np.linalg.cholesky(covariances)
        self._inverses = np.linalg.inv(covariances)
        self._heights = weights / (2 * np.pi * np.sqrt(np.linalg.det(covariances)))
        self._peak = self._heights.sum()
        """An upper bound of the density [1/m2]."""
        is_wide = self._peak * size_m.prod() < 1.0
        self._uniform = Uniform(size_m) if is_wide else None
        """If the density is much wider than the arena, uniform positions are kept with its probability."""

    def propose(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw positions (at most count, 2) [m]."""
        if self._uniform is not None:
            uniform_m = self._uniform.propose(rng, count)
            kept_m: Floats = uniform_m[rng.random(count) * self._peak < self.at(uniform_m)]
            return kept_m
        parts = np.searchsorted(self._shares[:-1], rng.random(count)) if len(self._shares) > 1 else np.zeros(count, int)
        offsets_m = np.einsum("nij,nj->ni", self._factors_m[parts], rng.standard_normal((count, 2)))
        drawn_m: Floats = self.centres_m[parts] + offsets_m
        return drawn_m

    def at(self, places_m: Floats) -> Floats:
        """Return the density at positions (n, 2) [1/m2]."""
        offsets_m = places_m[:, None, :] - self.centres_m
        squares = np.einsum("npi,pij,npj->np", offsets_m, self._inverses, offsets_m)
        density: Floats = np.exp(-0.5 * squares) @ self._heights
        return density


class Grid:
    """Cells of equal size with a weight each: rows from y = 0 upwards, columns from x = 0."""

    def __init__(self, weights: Floats, size_m: Floats) -> None:
        self._weights = weights
        self._shares = np.cumsum(weights.ravel() / weights.sum())
        self._cell_m: Floats = size_m / [weights.shape[1], weights.shape[0]]
        self.centres_m: Floats = (self._corners(np.arange(weights.size)) + 0.5) * self._cell_m

    def propose(self, rng: np.random.Generator, count: int) -> Floats:
        cells = np.searchsorted(self._shares[:-1], rng.random(count), side="right")
        places_m: Floats = (self._corners(cells) + rng.random((count, 2))) * self._cell_m
        return places_m

    def at(self, places_m: Floats) -> Floats:
        last = [self._weights.shape[1] - 1, self._weights.shape[0] - 1]
        columns, rows = np.minimum(places_m // self._cell_m, last).astype(int).T
        weights: Floats = self._weights[rows, columns]
        return weights

    def _corners(self, cells: "np.ndarray[tuple[int], np.dtype[np.intp]]") -> Floats:
        columns = self._weights.shape[1]
        return np.stack([cells % columns, cells // columns], axis=1).astype(np.float64)


Density = Uniform | Normals | Grid
"""A density before it is truncated, with positions (n, 2) `centres_m` at which it may have a peak [m]."""


class Places:
    """Draws positions from a density that is truncated to the arena and to what no obstacle covers."""

    def __init__(self, settings: DensitySettings, arena: ArenaSettings, obstacles: Obstacles) -> None:
        self._size_m = np.array([arena.width_m, arena.height_m])
        self._obstacles = obstacles
        self._density = _density(settings, self._size_m)
        self._moving = settings if settings.moves else None
        self._densest: tuple[float, tuple[float, float] | None] | None = None
        """A time [s] and the densest position then [m]."""

    def draw(self, rng: np.random.Generator, time_s: float) -> tuple[float, float]:
        """Draw one position (x_m, y_m) at a time [s]: the first of the proposed ones that is free."""
        density = self._density_at(time_s)
        batch = 1
        for _ in range(MAX_BATCHES):
            places_m = density.propose(rng, batch)
            is_free = self._free(places_m)
            if is_free.any():
                x_m, y_m = places_m[is_free.argmax()].tolist()
                return x_m, y_m
            batch = min(8 * batch, MAX_BATCH)
        raise ValueError("events.density must reach into the arena and outside obstacles")

    def densest_m(self, time_s: float) -> tuple[float, float] | None:
        """Return the free position with the highest density [m]; None if the density is the same everywhere.

        For a density that moves, the result is that of the last multiple of `DENSEST_EVERY_S`.
        """
        found_s = time_s // DENSEST_EVERY_S * DENSEST_EVERY_S if self._moving else 0.0
        if self._densest is None or self._densest[0] != found_s:
            self._densest = found_s, self._find_densest(self._density_at(found_s))
        return self._densest[1]

    def _find_densest(self, density: Density) -> tuple[float, float] | None:
        if self._moving and len(density.centres_m) == 1 and self._free(density.centres_m).all():
            x_m, y_m = density.centres_m[0].tolist()  # a single normal distribution peaks at its mean: no search
            return x_m, y_m
        along = (np.arange(MESH) + 0.5) / MESH
        mesh_m = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2) * self._size_m
        places_m = np.concatenate([density.centres_m, mesh_m])
        places_m = places_m[self._free(places_m)]
        values = density.at(places_m)
        if not len(values) or np.ptp(values) <= 1e-9 * values.max():
            return None
        x_m, y_m = places_m[values.argmax()].tolist()
        return x_m, y_m

    def _density_at(self, time_s: float) -> Density:
        if self._moving is None:
            return self._density
        moved = copy(self._density)
        moved.centres_m = np.array([mean for _, mean, _ in self._moving.normals_at(time_s)])
        return moved

    def _free(self, places_m: Floats) -> Mask:
        inside = (places_m >= 0.0) & (places_m <= self._size_m)
        is_free: Mask = inside[:, 0] & inside[:, 1]
        return is_free & ~self._obstacles.inside(places_m) if self._obstacles else is_free


def _density(settings: DensitySettings, size_m: Floats) -> Density:
    if settings.kind == "grid":
        return Grid(load_grid(settings.file), size_m)
    return Uniform(size_m) if settings.kind == "uniform" else Normals(settings.normals_at(0.0), size_m)


def load_grid(file: str) -> Floats:
    """The weights of a grid, rows from y = 0 upwards, columns from x = 0."""
    try:
        return read_grid(file)
    except (OSError, ValueError) as error:
        why = f"must be readable ({error.strerror})" if isinstance(error, OSError) else f"must be a grid: {error}"
        raise SettingsError([Problem("events.density.file", repr(file), why)]) from None
