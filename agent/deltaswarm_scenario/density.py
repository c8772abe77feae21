"""The density of events phi(x, y) (Experimental Setup), and checks that events can occur somewhere."""

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

from deltaswarm_wire.checked import PAPER, Problem, key, plain_value
from deltaswarm_wire.obstacles import ObstacleSettings, coordinate_problems, is_inside

DENSITIES = ("gaussian", "mixture", "uniform", "grid")

MIN_SHARE = 1e-5
"""A density with a smaller share of its mass in the arena and outside obstacles is refused."""

MIN_ROOM = 1e-3
"""Obstacles that leave a smaller share of the arena free are refused."""

SAMPLES = 4096
"""Positions at which a density is evaluated to estimate its share."""

COARSE_SAMPLES, CLEAR_SHARE = 64, 10 * MIN_SHARE
"""A density that moves is first evaluated at this number of positions; only if they show less than this share, at all
`SAMPLES`."""

BETWEEN, MOMENTS = 8, 256
"""Number of times checked between two waypoints. A path with many waypoints gets fewer (at least 1), about `MOMENTS`
in total."""

REACH = 6.0
"""A normal distribution is evaluated within this many standard deviations."""

PATH_DOC = "waypoints of its mean, joined by straight lines, instead of mean_m [m]"
TIMES_DOC = "time at each waypoint; two equal times are a jump [s]"

Component = tuple[float, tuple[float, ...], tuple[tuple[float, ...], ...]]
"""Weight, mean [m] and covariance [m2] of a normal distribution."""


@dataclass(frozen=True)
class ComponentSettings:
    """One normal distribution of a mixture. It stands at `mean_m`, or moves along `path_m`."""

    weight: float = key(1.0, "share of the events, relative to the other components", above=0)
    mean_m: tuple[float, ...] = key((50.0, 50.0), "mean [m]", length=2)
    covariance_m2: tuple[tuple[float, ...], ...] = key(((50.0, 0.0), (0.0, 50.0)), "covariance [m2]", length=2)
    path_m: tuple[tuple[float, ...], ...] = key((), PATH_DOC)
    path_s: tuple[float, ...] = key((), TIMES_DOC, low=0, high=1e8)

    def problems(self) -> list[Problem]:
        """A covariance must be symmetric and positive definite; a path has times in order, one for each waypoint."""
        problems = coordinate_problems("path_m", self.path_m)
        if len(self.path_s) != len(self.path_m):
            counts = f"{len(self.path_s)} for {len(self.path_m)} waypoints"
            problems.append(Problem("path_s", counts, "must have one time for each waypoint of path_m"))
        problems += [
            Problem(f"path_s[{index}]", f"{later:.15g}", f"must be at least the time before it, {earlier:.15g} s")
            for index, (earlier, later) in enumerate(pairwise(self.path_s), 1)
            if later < earlier
        ]
        (a, b), (c, d) = self.covariance_m2
        if b != c or a <= 0 or not a * d - b * c > 0:
            allowed = "must be a symmetric, positive definite matrix"
            problems.append(Problem("covariance_m2", _shown(self.covariance_m2), allowed))
        return problems

    def mean_at(self, time_s: float) -> tuple[float, ...]:
        """Return the mean at a time [m]: linear between waypoints; of two at the same time, the later one holds."""
        if not self.path_m:
            return self.mean_m
        after = bisect_right(self.path_s, time_s)
        if after in (0, len(self.path_s)):
            return self.path_m[max(0, after - 1)]
        (start_s, end_s), (start_m, end_m) = self.path_s[after - 1 : after + 1], self.path_m[after - 1 : after + 1]
        share = (time_s - start_s) / (end_s - start_s)
        return tuple(start + share * (end - start) for start, end in zip(start_m, end_m, strict=True))


@dataclass(frozen=True)
class DensitySettings:
    """The density of events, truncated to the arena and to what no obstacle covers."""

    kind: str = key("gaussian", "family of the density", source=PAPER, choices=DENSITIES)
    mean_m: tuple[float, ...] = key((50.0, 50.0), "gaussian: mean [m]", source=PAPER, length=2)
    covariance_m2: tuple[tuple[float, ...], ...] = key(
        ((50.0, 0.0), (0.0, 50.0)), "gaussian: covariance [m2]", source=PAPER, length=2
    )
    path_m: tuple[tuple[float, ...], ...] = key((), f"gaussian: {PATH_DOC}")
    path_s: tuple[float, ...] = key((), f"gaussian: {TIMES_DOC}", low=0, high=1e8)
    components: tuple[ComponentSettings, ...] = key((), "mixture: its normal distributions")
    file: str = key("", "grid: a .npy or .csv file of weights, rows from y = 0 upwards")

    def problems(self) -> list[Problem]:
        """The keys of the chosen family must be given, and only a normal distribution has a path."""
        if self.kind == "gaussian":
            return self._gaussian.problems()
        problems = ComponentSettings(1.0, self.mean_m, self.covariance_m2).problems()
        allowed = f"must be empty with kind {self.kind}: only a gaussian or a component moves"
        paths = (("path_m", self.path_m), ("path_s", self.path_s))
        problems += [Problem(name, _shown(value), allowed) for name, value in paths if value]
        if self.kind == "mixture" and not self.components:
            problems.append(Problem("components", "none", "must have at least one item for a mixture"))
        if self.kind == "grid" and not self.file.endswith((".npy", ".csv")):
            problems.append(Problem("file", repr(self.file), "must be a .npy or .csv file for a grid"))
        return problems

    @property
    def _gaussian(self) -> ComponentSettings:
        return ComponentSettings(1.0, self.mean_m, self.covariance_m2, self.path_m, self.path_s)

    @property
    def parts(self) -> tuple[ComponentSettings, ...]:
        """The normal distributions of a gaussian or mixture; none of other kinds."""
        if self.kind == "gaussian":
            return (self._gaussian,)
        return self.components if self.kind == "mixture" else ()

    @property
    def moves(self) -> bool:
        """Whether a normal distribution has a path."""
        return any(part.path_m for part in self.parts)

    def normals_at(self, time_s: float) -> list[Component]:
        """Return the normal distributions at a time [s], with weights whose sum is 1; none of other kinds."""
        total = sum(part.weight for part in self.parts)
        return [(part.weight / total, part.mean_at(time_s), part.covariance_m2) for part in self.parts]


def density_problems(
    density: DensitySettings, size_m: tuple[float, float], obstacles: tuple[ObstacleSettings, ...]
) -> list[Problem]:
    """Check that events can occur at any time: means within the arena, and mass in it and outside obstacles."""
    allowed = f"must be within the arena, {size_m[0]:.15g} m x {size_m[1]:.15g} m"
    problems = [
        Problem(f"events.density.{where}", _shown(mean), allowed)
        for where, mean in _means(density)
        if not (0 <= mean[0] <= size_m[0] and 0 <= mean[1] <= size_m[1])
    ]
    return problems or list(_mass_problems(density, size_m, obstacles))


def room_problems(size_m: tuple[float, float], obstacles: tuple[ObstacleSettings, ...]) -> list[Problem]:
    """Check that obstacles leave room for agents."""
    free = free_share(size_m, obstacles)
    allowed = f"must leave at least {100 * MIN_ROOM:.15g} % of the arena free"
    return [] if free >= MIN_ROOM else [Problem("arena.obstacles", f"{100 * free:.2g} %", allowed)]


def share_problems(share: float, when: str = "") -> list[Problem]:
    """Check the share of a density's mass that is in the arena and outside obstacles."""
    allowed = f"must have at least {100 * MIN_SHARE:.15g} % of its mass in the arena and outside obstacles"
    return [] if share >= MIN_SHARE else [Problem("events.density", f"{100 * share:.2g} %{when}", allowed)]


def _means(density: DensitySettings) -> Iterator[tuple[str, tuple[float, ...]]]:
    for index, part in enumerate(density.parts):
        where = f"components[{index}]." if density.kind == "mixture" else ""
        if part.path_m:
            yield from ((f"{where}path_m[{number}]", place) for number, place in enumerate(part.path_m))
        else:
            yield f"{where}mean_m", part.mean_m


@lru_cache(maxsize=1024)
def _mass_problems(
    density: DensitySettings, size_m: tuple[float, float], obstacles: tuple[ObstacleSettings, ...]
) -> Sequence[Problem]:
    """Check the mass of a density; of a grid, whose weights are in a file, only the free share of the arena."""
    if not density.parts:
        return share_problems(free_share(size_m, obstacles))
    for time_s in _moments(density):
        normals = density.normals_at(time_s)
        if density.moves and share_inside(normals, size_m, obstacles, COARSE_SAMPLES) >= CLEAR_SHARE:
            continue
        when = f" at {time_s:.15g} s" if density.moves else ""
        if problems := share_problems(share_inside(normals, size_m, obstacles), when):
            return problems
    return ()


def _moments(density: DensitySettings) -> list[float]:
    """Return the times at which to check a density [s]: waypoints, both sides of jumps, and moments in between.

    Of several times with the same means, only the first is returned.
    """
    knots = sorted({0.0, *(time_s for part in density.parts for time_s in part.path_s)})
    count = 1 + max(1, min(BETWEEN, MOMENTS // len(knots)))
    times = [start + (end - start) * number / count for start, end in pairwise(knots) for number in range(count)]
    times += [knots[-1], *(math.nextafter(end, 0.0) for end in knots[1:])]
    first: dict[tuple[float, ...], float] = {}
    for time_s in sorted(times):
        first.setdefault(tuple(round(x, 6) for part in density.parts for x in part.mean_at(time_s)), time_s)
    return list(first.values())


@lru_cache(maxsize=1024)
def free_share(size_m: tuple[float, float], obstacles: tuple[ObstacleSettings, ...]) -> float:
    """Estimate the share of the arena that no obstacle covers."""
    return sum(is_free(place, obstacles) for place in spread((0.0, 0.0), size_m)) / SAMPLES if obstacles else 1.0


def share_inside(
    normals: Sequence[Component],
    size_m: tuple[float, float],
    obstacles: tuple[ObstacleSettings, ...],
    samples: int = SAMPLES,
) -> float:
    """Estimate the share of a mixture's mass that is in the arena and outside obstacles."""
    share = 0.0
    for weight, mean, ((a, b), (_, d)) in normals:
        low = tuple(max(0.0, at - REACH * math.sqrt(variance)) for at, variance in zip(mean, (a, d), strict=True))
        high = [min(end, at + REACH * math.sqrt(v)) for end, at, v in zip(size_m, mean, (a, d), strict=True)]
        determinant = a * d - b * b
        total = 0.0
        for x, y in spread(low, high, samples):
            dx, dy = x - mean[0], y - mean[1]
            if is_free((x, y), obstacles):
                total += math.exp(-0.5 * (d * dx * dx - 2 * b * dx * dy + a * dy * dy) / determinant)
        area_m2 = (high[0] - low[0]) * (high[1] - low[1])
        share += weight * total / samples * area_m2 / (2 * math.pi * math.sqrt(determinant))
    return min(1.0, share)


def is_free(place: Sequence[float], obstacles: Sequence[ObstacleSettings]) -> bool:
    return not any(is_inside(place, obstacle.corners_m) for obstacle in obstacles)


def spread(low: Sequence[float], high: Sequence[float], count: int = SAMPLES) -> Iterator[tuple[float, float]]:
    """Yield evenly spread positions in a rectangle (the R2 sequence of Roberts), which no strip escapes."""
    width, height = high[0] - low[0], high[1] - low[1]
    for index in range(count):
        yield low[0] + width * (index * 0.7548776662466927 % 1), low[1] + height * (index * 0.5698402909980532 % 1)


def _shown(value: object) -> str:
    return str(plain_value(value))[:60]
