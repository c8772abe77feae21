"""The points of a sensitivity sweep: scenario keys drawn from ranges, for all variants alike."""

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from deltaswarm_wire.checked import Problem, key, shown_limit

LATIN_HYPERCUBE, SOBOL = "latin-hypercube", "sobol"
LINEAR, LOG = "linear", "log"

MIN_POINTS_PER_RANGE = 10
"""The usual rule for the size of a design (Loeppky, Sacks and Welch 2009, doi 10.1198/TECH.2009.08040)."""

MAX_POINTS = 100_000

Point = dict[str, Any]
"""Dotted scenario keys with what was drawn: numbers, and names of choices."""


@dataclass(frozen=True)
class RangeSettings:
    """A table `[[sensitivity.range]]`: a scenario key, and where its values are drawn from."""

    name: str = key("", "the scenario key, dotted")
    title: str = key("", "for people, without the unit: of axes, tables and legends")
    unit: str = key("", "its unit")
    low: float | None = key(None, "least value")
    high: float | None = key(None, "greatest value")
    scale: str = key(LINEAR, "values are uniform, or uniform in their logarithm", choices=(LINEAR, LOG))
    integer: bool = key(False, "draw whole numbers, both ends included")
    choices: dict[str, Any] = key(dict, "instead: values with a name for each, drawn equally often")

    def problems(self) -> Iterator[Problem]:
        """List what is missing or cannot be drawn from."""
        for name in ("name", "title"):
            if not getattr(self, name).strip():
                yield Problem(name, "missing", "a range needs it")
        if self.title and self.title == self.name:
            yield Problem("title", repr(self.title), "must be words for people, not the key")
        if self.choices:
            for name in ("low", "high", "integer", "unit"):
                if getattr(self, name) not in (None, False, ""):
                    yield Problem(name, repr(getattr(self, name)), "must not be given with choices")
            values = [repr(value) for value in self.choices.values()]
            if len(set(values)) < max(len(values), 2):
                yield Problem("choices", ", ".join(values), "must be at least two different values")
            return
        if self.low is None or self.high is None:
            lacking = "low" if self.low is None else "high"
            yield Problem(lacking, "missing", "a range needs low and high, or choices")
        elif not self.low < self.high:
            yield Problem("high", f"{self.high:.15g}", f"must be above low, {self.low:.15g}")
        elif self.scale == LOG and self.low <= 0:
            yield Problem("low", f"{self.low:.15g}", "must be above 0 on a logarithmic scale")
        elif self.integer and not (self.low.is_integer() and self.high.is_integer()):
            yield Problem("low", f"{self.low:.15g} to {self.high:.15g}", "must be whole numbers, as high, with integer")

    @property
    def label(self) -> str:
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def ends(self) -> list[Any]:
        """The least and the greatest value; of choices, all names."""
        if self.choices:
            return list(self.choices)
        return [int(end) if self.integer else end for end in (self.low, self.high) if end is not None]

    @property
    def distribution(self) -> str:
        if self.choices:
            return f"{', '.join(self.choices)}: equally often"
        low, high = map(shown_limit, self.ends)
        kind = "whole numbers, uniform" if self.integer else "uniform"
        return f"{low} to {high}: {kind}{' in the logarithm' if self.scale == LOG else ''}"

    def at(self, share: float) -> Any:
        """Return the number below which this share of the distribution lies, or the choice's name."""
        if self.choices or self.low is None or self.high is None:
            return self.ends[min(int(share * len(self.ends)), len(self.ends) - 1)]
        half = 0.5 if self.integer else 0.0  # so that both ends are drawn as often as what lies between them
        low, high = self.low - half, self.high + half
        value = low * (high / low) ** share if self.scale == LOG else low + share * (high - low)
        inside = min(max(round(value) if self.integer else value, self.low), self.high)
        return int(inside) if self.integer else inside

    def value(self, drawn: Any) -> Any:
        return self.choices[drawn] if self.choices else drawn


@dataclass(frozen=True)
class SensitivitySettings:
    """The table `[sensitivity]`."""

    method: str = key(
        LATIN_HYPERCUBE,
        "how points are spread over the ranges; sobol: scrambled, and `points` must be a power of two",
        choices=(LATIN_HYPERCUBE, SOBOL),
    )
    points: int = key(300, "number of points, at least ten for each range", low=1, high=MAX_POINTS)
    runs_per_point: int = key(1, "runs of each variant at a point; studies judge their mean", low=1, high=1000)
    seed: int = key(1, "of the drawing; the runs' seeds are derived from `sweep.seed`", low=0, high=2**63 - 1)
    range: tuple[RangeSettings, ...] = key((), "the keys that are drawn")

    def problems(self) -> Iterator[Problem]:
        """There must be ranges, and points enough for them."""
        if not self.range:
            yield Problem("range", "none", "a sensitivity sweep needs at least one [[sensitivity.range]]")
        for what, words in (("keys", [one.name for one in self.range]), ("titles", [one.title for one in self.range])):
            for name, times in Counter(words).items():
                if times > 1 and name:
                    yield Problem("range", f"{times} of {name!r}", f"must have different {what}")
        if self.points * self.runs_per_point > MAX_POINTS:
            runs = f"{self.points} x {self.runs_per_point}"
            yield Problem("runs_per_point", runs, f"must be at most {MAX_POINTS} runs of a variant at all points")
        least = MIN_POINTS_PER_RANGE * len(self.range)
        if self.points < least:
            allowed = f"must be at least {least}, {MIN_POINTS_PER_RANGE} for each of {len(self.range)} ranges"
            yield Problem("points", str(self.points), allowed)
        elif self.method == SOBOL and self.points & (self.points - 1):
            above = 1 << self.points.bit_length()
            near = [power for power in (above // 2, above) if power >= least]
            allowed = f"must be a power of two for a Sobol sequence, such as {' or '.join(map(str, near))}"
            yield Problem("points", str(self.points), allowed)

    @property
    def design(self) -> str:
        return "a scrambled Sobol sequence" if self.method == SOBOL else "a Latin hypercube"


def drawn(settings: SensitivitySettings) -> list[Point]:
    """Draw all points; the same settings give the same points."""
    from scipy.stats import qmc  # slow to import, and not needed for other sweeps

    method = qmc.Sobol if settings.method == SOBOL else qmc.LatinHypercube
    shares = method(len(settings.range), rng=settings.seed).random(settings.points)
    return [
        {one.name: one.at(share) for one, share in zip(settings.range, row, strict=True)} for row in shares.tolist()
    ]


def corners(settings: SensitivitySettings, point: Point) -> Iterator[Point]:
    """Yield a point with each pair of ranges at each pair of their ends."""
    for some in itertools.combinations(settings.range, min(2, len(settings.range))):
        for ends in itertools.product(*(one.ends for one in some)):
            yield {**point, **{one.name: end for one, end in zip(some, ends, strict=True)}}
