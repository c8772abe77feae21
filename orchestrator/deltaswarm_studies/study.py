"""A study: a sweep, the questions about it, and what their names refer to."""

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from deltaswarm_orchestrator.sweeps.plan import LABEL, Sweep, flattened
from deltaswarm_orchestrator.sweeps.sensitivity import RangeSettings
from deltaswarm_studies.metrics import StudyMetric, Timing
from deltaswarm_studies.settings import ContrastSettings, StudyFile
from deltaswarm_wire import checked

INTERACTION = " against "


class Comparison(NamedTuple):
    """One row of a contrast: two levels within a cell of the other factors."""

    level: str
    reference: str
    within: str
    """Name of the cell; of an interaction, also of the pair of levels that it is between."""
    sides: tuple[tuple[str, str], ...]
    """The variants with `level` and with `reference`; of an interaction, those of both levels that it is between."""


@dataclass(frozen=True)
class Study:
    """A complete, checked study."""

    name: str
    file: StudyFile
    sweep: Sweep
    factors: Mapping[str, Sequence[str]]
    """The levels of each factor, in order."""
    metrics: Mapping[str, StudyMetric]
    """Every metric that may be named: the built-in ones and the study's own."""
    is_built_in: bool = False

    @property
    def title(self) -> str:
        """Title of the page."""
        return self.file.study.title or self.name

    @cached_property
    def timing(self) -> Timing:
        """Lengths of time in the runs."""
        runs = {variant.label: variant.scenario.run for variant in self.sweep.variants}
        steps_s = {label: run.step_s for label, run in runs.items()}
        ends_s = {label: run.duration_s for label, run in runs.items()}
        return Timing(steps_s, ends_s, self.sweep.file.sweep.series_every_s)

    @property
    def repeats(self) -> int:
        """Replicates of each variant."""
        return self.sweep.file.sweep.repeats

    @property
    def ranges(self) -> Sequence[RangeSettings]:
        """What a sensitivity study draws; empty if it is none."""
        sensitivity = self.sweep.file.sensitivity
        return sensitivity.range if sensitivity else ()

    @property
    def digests(self) -> tuple[str, str]:
        """Digests of what the study file runs, and of what it asks."""
        sweep = checked.plain(self.sweep.file)
        sweep["base"] = Path(sweep["base"]).name
        tables = (sweep, checked.plain(self.file))
        runs, questions = (hashlib.blake2b(json.dumps(table).encode(), digest_size=8).hexdigest() for table in tables)
        return runs, questions

    def factor_title(self, factor: str) -> str:
        """Return a factor's name for people."""
        return str(self.file.study.factors.get(factor, factor))

    def numbers(self, factor: str) -> dict[str, float]:
        """Return the number of each level of a factor; empty if the levels are not numbers."""
        return numbers_in(self.factors[factor])

    @cached_property
    def levels(self) -> Mapping[str, Mapping[str, str]]:
        """Each variant's level of each factor."""
        places = itertools.product(*self.factors.values())
        labels = [variant.label for variant in self.sweep.variants]
        return {label: dict(zip(self.factors, place, strict=True)) for label, place in zip(labels, places, strict=True)}

    def cells(self, without: Sequence[str]) -> list[dict[str, str]]:
        """List every combination of levels of all factors except `without`."""
        others = {factor: levels for factor, levels in self.factors.items() if factor not in without}
        return [dict(zip(others, place, strict=True)) for place in itertools.product(*others.values())]

    def comparisons(self, contrast: ContrastSettings) -> Iterator[Comparison]:
        """Yield the rows of a contrast."""
        labels = {tuple(levels.values()): label for label, levels in self.levels.items()}

        def variant(cell: Mapping[str, str]) -> str:
            return labels[tuple(cell[factor] for factor in self.factors)]

        factor, across = contrast.factor, contrast.across
        levels = self.factors[factor]
        pairs = contrast.pairs or [(level, contrast.reference) for level in levels if level != contrast.reference]
        for level, reference in pairs:
            for cell in self.cells([factor, *([across] if across else [])]):
                for ends in contrast.across_pairs if across else [()]:
                    wholes = [{**cell, across: end} for end in ends] if across else [cell]
                    sides = tuple(
                        (variant({**whole, factor: level}), variant({**whole, factor: reference})) for whole in wholes
                    )
                    within = ", ".join([*cell.values(), *([INTERACTION.join(ends)] if across else [])])
                    yield Comparison(level, reference, within, sides)

    def metrics_of(self, contrast: ContrastSettings) -> Sequence[str]:
        """Return the metrics that a contrast is about."""
        return contrast.metrics or self.file.study.metrics


def default_factors(sweep: Sweep) -> list[str]:
    """Name each of a sweep's factors by the last part of the first key that it varies."""
    settings = sweep.file.sweep
    keys = [name for name, _ in flattened(settings.axes)]
    keys += [next(name for name, _ in flattened(table) if name != LABEL) for table in settings.paired]
    names = [key.rpartition(".")[2] for key in keys]
    names += ["variant"] if len(names) < len(sweep.factors) else []
    return [name if names.count(name) == 1 else f"{name} {index + 1}" for index, name in enumerate(names)]


def numbers_in(levels: Sequence[str]) -> dict[str, float]:
    """Return the number of each level if all levels are swept numbers such as `loss=0.1`; else an empty dict."""
    try:
        return {level: float(level.partition("=")[2]) for level in levels}
    except ValueError:
        return {}
