"""Where events occur: the density phi(x, y) (Experimental Setup), and whether any of it lies where events can be."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from deltaswarm_wire.checked import PAPER, Problem, key, plain_value
from deltaswarm_wire.settings_obstacles import ObstacleSettings, is_inside

DENSITIES = ("gaussian", "mixture", "uniform", "grid")

MIN_SHARE = 1e-5
"""A density with a smaller share of its mass in the arena and outside obstacles is refused."""

MIN_ROOM = 1e-3
"""Obstacles that leave a smaller share of the arena free are refused."""

SAMPLES = 4096
"""Positions at which a density is evaluated to estimate its share."""

REACH = 6.0
"""A normal distribution is evaluated within this many standard deviations."""

Component = tuple[float, tuple[float, ...], tuple[tuple[float, ...], ...]]
"""Weight, mean [m] and covariance [m2] of a normal distribution."""


@dataclass(frozen=True)
class ComponentSettings:
    """One normal distribution of a mixture."""

    weight: float = key(1.0, "share of the events, relative to the other components", above=0)
    mean_m: tuple[float, ...] = key((50.0, 50.0), "mean [m]", length=2)
    covariance_m2: tuple[tuple[float, ...], ...] = key(((50.0, 0.0), (0.0, 50.0)), "covariance [m2]", length=2)

    def problems(self) -> list[Problem]:
        """A covariance must be symmetric and positive definite."""
        (a, b), (c, d) = self.covariance_m2
        if b != c or a <= 0 or not a * d - b * c > 0:
            allowed = "must be a symmetric, positive definite matrix"
            return [Problem("covariance_m2", str(plain_value(self.covariance_m2)), allowed)]
        return []


@dataclass(frozen=True)
class DensitySettings:
    """The density of events, truncated to the arena and to what no obstacle covers."""

    kind: str = key("gaussian", "the family", source=PAPER, choices=DENSITIES)
    mean_m: tuple[float, ...] = key((50.0, 50.0), "gaussian: mean [m]", source=PAPER, length=2)
    covariance_m2: tuple[tuple[float, ...], ...] = key(
        ((50.0, 0.0), (0.0, 50.0)), "gaussian: covariance [m2]", source=PAPER, length=2
    )
    components: tuple[ComponentSettings, ...] = key((), "mixture: its normal distributions")
    file: str = key("", "grid: a .npy or .csv file of weights, rows from y = 0 upwards")

    def problems(self) -> list[Problem]:
        """The keys of the chosen family must be given."""
        found = ComponentSettings(1.0, self.mean_m, self.covariance_m2).problems()
        if self.kind == "mixture" and not self.components:
            found.append(Problem("components", "none", "must have at least one item for a mixture"))
        if self.kind == "grid" and not self.file.endswith((".npy", ".csv")):
            found.append(Problem("file", repr(self.file), "must be a .npy or .csv file for a grid"))
        return found

    @property
    def normals(self) -> list[Component]:
        """The normal distributions of a gaussian or mixture, with weights whose sum is 1; none of other kinds."""
        if self.kind == "gaussian":
            return [(1.0, self.mean_m, self.covariance_m2)]
        parts = self.components if self.kind == "mixture" else ()
        total = sum(part.weight for part in parts)
        return [(part.weight / total, part.mean_m, part.covariance_m2) for part in parts]


def density_problems(
    density: DensitySettings, size_m: tuple[float, float], obstacles: tuple[ObstacleSettings, ...]
) -> list[Problem]:
    """Check that events can occur: means within the arena, and mass in it and outside obstacles."""
    allowed = f"must be within the arena, {size_m[0]:g} m x {size_m[1]:g} m"
    found = [
        Problem(f"events.density.{where}mean_m", str(list(mean)), allowed)
        for where, mean in _means(density)
        if not (0 <= mean[0] <= size_m[0] and 0 <= mean[1] <= size_m[1])
    ]
    return found or share_problems(share_inside(density, size_m, obstacles))


def room_problems(size_m: tuple[float, float], obstacles: tuple[ObstacleSettings, ...]) -> list[Problem]:
    """Check that obstacles leave room for agents."""
    free = share_inside(DensitySettings("uniform"), size_m, obstacles)
    allowed = f"must leave at least {100 * MIN_ROOM:g} % of the arena free"
    return [] if free >= MIN_ROOM else [Problem("arena.obstacles", f"{100 * free:.2g} %", allowed)]


def share_problems(share: float) -> list[Problem]:
    """Check the share of a density's mass that is in the arena and outside obstacles."""
    allowed = f"must have at least {100 * MIN_SHARE:g} % of its mass in the arena and outside obstacles"
    return [] if share >= MIN_SHARE else [Problem("events.density", f"{100 * share:.2g} %", allowed)]


def _means(density: DensitySettings) -> Iterator[tuple[str, tuple[float, ...]]]:
    if density.kind == "gaussian":
        yield "", density.mean_m
    elif density.kind == "mixture":
        yield from ((f"components[{i}].", component.mean_m) for i, component in enumerate(density.components))


@lru_cache(maxsize=1024)
def share_inside(
    density: DensitySettings, size_m: tuple[float, float], obstacles: tuple[ObstacleSettings, ...]
) -> float:
    """Estimate the share of a density's mass that is in the arena and outside obstacles.

    Of a grid, whose weights are in a file, only the free share of the arena is known here.
    """
    if not density.normals:
        return sum(is_free(place, obstacles) for place in spread((0.0, 0.0), size_m)) / SAMPLES if obstacles else 1.0
    share = 0.0
    for weight, mean, ((a, b), (_, d)) in density.normals:
        low = tuple(max(0.0, at - REACH * math.sqrt(variance)) for at, variance in zip(mean, (a, d), strict=True))
        high = [min(end, at + REACH * math.sqrt(v)) for end, at, v in zip(size_m, mean, (a, d), strict=True)]
        determinant = a * d - b * b
        total = 0.0
        for x, y in spread(low, high):
            dx, dy = x - mean[0], y - mean[1]
            if is_free((x, y), obstacles):
                total += math.exp(-0.5 * (d * dx * dx - 2 * b * dx * dy + a * dy * dy) / determinant)
        area_m2 = (high[0] - low[0]) * (high[1] - low[1])
        share += weight * total / SAMPLES * area_m2 / (2 * math.pi * math.sqrt(determinant))
    return min(1.0, share)


def is_free(place: Sequence[float], obstacles: Sequence[ObstacleSettings]) -> bool:
    """Whether a position is outside all obstacles."""
    return not any(is_inside(place, obstacle.corners_m) for obstacle in obstacles)


def spread(low: Sequence[float], high: Sequence[float]) -> Iterator[tuple[float, float]]:
    """Yield `SAMPLES` evenly spread positions in a rectangle (the R2 sequence of Roberts), which no strip escapes."""
    width, height = high[0] - low[0], high[1] - low[1]
    for index in range(SAMPLES):
        yield low[0] + width * (index * 0.7548776662466927 % 1), low[1] + height * (index * 0.5698402909980532 % 1)
