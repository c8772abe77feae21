"""A study: a sweep, the questions about it, and how their names resolve."""

import hashlib
import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from deltaswarm_orchestrator.sweeps.plan import LABEL, Sweep, flattened
from deltaswarm_orchestrator.sweeps.sensitivity import RangeSettings
from deltaswarm_studies.claim_settings import OF_ORDER
from deltaswarm_studies.metrics import BUILT_IN, StudyMetric, Timing, controllers_own
from deltaswarm_studies.settings import ContrastSettings, StudyFile
from deltaswarm_wire import checked

INTERACTION = " against "

LATER = {"metric": ("price_s", "after_change"), "claim": OF_ORDER, "contrast": ("over", "cells")}
"""Keys that tables of study files got after studies had been published."""


class Comparison(NamedTuple):
    """One row of a contrast: two levels within a cell of the other factors."""

    level: str
    reference: str
    within: str
    """Name of the cell; of an interaction, also of the pair of levels that it is between."""
    sides: tuple[tuple[str, str], ...]
    """The variants with `level` and with `reference`; of an interaction, those of both levels that it is between; of a
    mean over a factor, those of each of its levels.
    """
    within_title: str
    """The cell's name for people."""
    cell: tuple[str, ...]
    """The levels that make up the cell."""
    between: tuple[str, ...]
    """Of an interaction, the levels that it is between."""


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
    left_out: tuple[str, ...] = ()
    """Parts of a report that cannot be shown and that nobody asked for, with the reason."""
    is_built_in: bool = False
    """Whether it comes with deltaswarm."""

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

    @cached_property
    def over_time(self) -> Mapping[str, StudyMetric]:
        """The metrics of runs, and of their controllers, that have a time series."""
        of_runs = {**BUILT_IN, **controllers_own(self.sweep)}
        return {name: metric for name, metric in of_runs.items() if metric.series}

    @property
    def repeats(self) -> int:
        """Replicates of every variant, of some there can be more; of a sensitivity study, points."""
        return self.sweep.file.sweep.repeats

    def repeats_of(self, variants: Iterable[str]) -> int:
        """Replicates, or points, that all of these variants have; of none named, that every variant has."""
        named = [*variants] or self.sweep.repeats
        return min(self.sweep.repeats[variant] for variant in named) // self.sweep.runs_per_point

    @property
    def ranges(self) -> Sequence[RangeSettings]:
        """The ranges of a sensitivity study; empty for other studies."""
        sensitivity = self.sweep.file.sensitivity
        return sensitivity.range if sensitivity else ()

    @property
    def averaged_over(self) -> set[str]:
        """The factors over whose levels claims and contrasts average."""
        return {
            over for over in (*(one.over for one in self.file.claim), *(one.over for one in self.file.contrast)) if over
        }

    @property
    def digests(self) -> tuple[str, str]:
        """Digests of what the study file runs, and of what it asks."""
        sweep, asked = checked.plain(self.sweep.file), checked.plain(self.file)
        sweep["base"] = Path(sweep["base"]).name
        later = [(sweep["sweep"], "repeats_of"), (asked["study"], "replaces")]
        later += [(row, key) for name, keys in LATER.items() for row in asked[name] for key in keys]
        for table, key in later:
            if not table[key]:  # so that files without it keep their digest
                del table[key]
        if self.ranges and self.sweep.runs_per_point == 1:
            del sweep["sensitivity"]["runs_per_point"]
        tables = (sweep, asked)
        runs, questions = (hashlib.blake2b(json.dumps(table).encode(), digest_size=8).hexdigest() for table in tables)
        return runs, questions

    def factor_title(self, factor: str) -> str:
        """Return a factor's name for people."""
        return str((self.file.study.factors or default_factors(self.sweep))[factor])

    def numbers(self, factor: str) -> dict[str, float]:
        """Return the number of each level of a factor; empty if the levels are not numbers."""
        return numbers_of(self.sweep, list(self.factors).index(factor))

    def level_name(self, factor: str, level: str) -> str:
        """Return a level for people: the value alone where the sweep named it by its key, as in `loss=0.5`."""
        key = swept_key(self.sweep, list(self.factors).index(factor))
        return level.removeprefix(f"{key.rpartition('.')[2]}=") if key else level

    def level_title(self, factor: str, level: str) -> str:
        """Return a level that stands alone: its name, after the factor's title if the name is but a value."""
        name = self.level_name(factor, level)
        return name if name == level else f"{self.factor_title(factor)}: {name}"

    def legend_title(self, factor: str) -> str:
        """Return the title that a legend of a factor's levels needs: none where the levels speak for themselves."""
        return self.factor_title(factor) if factor and swept_key(self.sweep, list(self.factors).index(factor)) else ""

    def variant_title(self, variant: str) -> str:
        """Return a variant's name for people."""
        return self.cell_title(self.levels[variant])

    def cell_title(self, cell: Mapping[str, str]) -> str:
        """Return the name of a combination of factors' levels for people."""
        return ", ".join(self.level_title(factor, level) for factor, level in cell.items())

    def words(self, level: str) -> str:
        """Return a level, or a factor for all of its levels, as a sentence has it."""
        factor = next((name for name, levels in self.factors.items() if level in levels), "")
        default = f"with {self.level_title(factor, level)}" if factor else f"whatever the {level}"
        return self.file.study.words.get(level, default)

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

        factor, across, over = contrast.factor, contrast.across, contrast.over
        levels = self.factors[factor]
        pooled = contrast.cells or (self.factors[over] if over else ())
        pairs = contrast.pairs or [(level, contrast.reference) for level in levels if level != contrast.reference]
        for level, reference in pairs:
            for cell in self.cells(list(filter(None, (factor, across, over)))):
                for ends in contrast.across_pairs if across else [()]:
                    name, along = (across, ends) if across else (over, pooled)
                    wholes = [{**cell, name: end} for end in along] if name else [cell]
                    sides = tuple(
                        (variant({**whole, factor: level}), variant({**whole, factor: reference})) for whole in wholes
                    )
                    mean = [f"mean over {self.factor_title(over)}"] if over else []
                    within = ", ".join([*cell.values(), *([INTERACTION.join(ends)] if across else []), *mean])
                    between = [INTERACTION.join(self.level_title(across, end) for end in ends)] if across else []
                    title = ", ".join(filter(None, [self.cell_title(cell), *between, *mean]))
                    yield Comparison(level, reference, within, sides, title, tuple(cell.values()), tuple(ends))

    def along(self, factor: str, levels: Sequence[str]) -> Mapping[str, Sequence[str]]:
        """Return the variants with these levels of a factor, or with any, by their names without the level."""
        found: dict[str, list[str]] = {}
        for label, own in self.levels.items():
            if own.get(factor) in (levels or self.factors.get(factor, ())):
                found.setdefault(", ".join(own[name] for name in own if name != factor), []).append(label)
        return found

    def metrics_of(self, contrast: ContrastSettings) -> Sequence[str]:
        """Return the metrics that a contrast is about."""
        return contrast.metrics or self.file.study.metrics


def default_factors(sweep: Sweep) -> dict[str, str]:
    """Name each of a sweep's factors by the last part of the first key that it varies; return also their titles."""
    settings = sweep.file.sweep
    keys = [name for name, _ in flattened(settings.axes)]
    keys += [next(name for name, _ in flattened(table) if name != LABEL) for table in settings.paired]
    keys += ["variant"] if len(keys) < len(sweep.factors) else []
    names = [key.rpartition(".")[2] for key in keys]
    unique = [name if names.count(name) == 1 else f"{name} {index + 1}" for index, name in enumerate(names)]
    return dict(zip(unique, map(title_of, keys), strict=True))


UNITS = {
    "_bytes_per_s": "bytes/s",
    "_work_agent_s": "agent s",
    "_per_s": "1/s",
    "_mps": "m/s",
    "_m2": "m2",
    "_hz": "1/s",
    "_dbm": "dBm",
    "_db": "dB",
    "_bytes": "bytes",
    "_m": "m",
    "_s": "s",
}
"""The unit of a key by the end of its name, the longest ends first."""


def title_of(key: str) -> str:
    """Return a dotted key for people: its last part in words, with the unit."""
    name = key.rpartition(".")[2]
    end, unit = next(((end, unit) for end, unit in UNITS.items() if name.endswith(end)), ("", ""))
    words = name.removesuffix(end).replace("_", " ")
    return f"{words} [{unit.replace('m2', 'm²')}]" if unit else words


def swept_key(sweep: Sweep, place: int) -> str:
    """Return the key that the factor at this place of a sweep varies; empty unless it is an axis of its own."""
    keys = [name for name, _ in flattened(sweep.file.sweep.axes)]
    return keys[place] if place < len(keys) else ""


def numbers_of(sweep: Sweep, place: int) -> dict[str, float]:
    """Return the number of each level of a sweep's factor; empty if it is no axis, or a value is no number."""
    key = swept_key(sweep, place)
    values = {
        levels[place]: variant.keys.get(key)
        for levels, variant in zip(itertools.product(*sweep.factors), sweep.variants, strict=True)
    }
    numbers = {
        level: float(value)
        for level, value in values.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
    return numbers if len(numbers) == len(values) else {}
