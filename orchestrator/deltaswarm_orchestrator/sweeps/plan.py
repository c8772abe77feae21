"""A sweep: a base scenario, keys that vary, and replicates with seeds of their own."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import orjson

from deltaswarm_orchestrator.base.inputs import Inputs, identify
from deltaswarm_orchestrator.base.provenance import sources
from deltaswarm_orchestrator.sweeps.sensitivity import SensitivitySettings
from deltaswarm_scenario.scenario import NAME, Scenario, content_of
from deltaswarm_wire.checked import Problem, key

MAX_RUNS = 100_000
SEED_BITS = 53
"""Length of a seed: one of 53 bits stays exact in a spreadsheet and in JSON."""

LABEL = "label"
"""In `[[sweep.paired]]` and `[[sweep.variants]]`, this is the name of a variant, not a scenario key."""


@dataclass(frozen=True)
class SweepSettings:
    """The table `[sweep]` of a sweep file."""

    seed: int = key(
        1, "the replicates' seeds are derived from it (frozen studies: from the protocol)", low=0, high=2**63 - 1
    )
    repeats: int = key(
        20, "replicates of each variant; of a sensitivity sweep, points to run (default: all)", low=1, high=MAX_RUNS
    )
    repeats_of: dict[str, int] = key(dict, "replicates of single variants, by label, where `repeats` are too few")
    prove: int = key(1, "runs that real processes do too, to compare the digests", low=0, high=MAX_RUNS)
    series_every_s: float = key(60.0, "length of a window of the time series [s]; 0: none", low=0, high=1e8)
    axes: dict[str, Any] = key(dict, "dotted scenario keys with lists of values: every combination is run")
    paired: tuple[dict[str, Any], ...] = key((), "tables of keys whose lists vary together, with labels if you like")
    variants: tuple[dict[str, Any], ...] = key((), "single variants: what each changes, with a label if you like")


@dataclass(frozen=True)
class SweepFile:
    """The content of a sweep file (TOML)."""

    schema: int = key(1, "version of this table", low=1, high=1)
    name: str = key("sweep", "used in the sweep folder's name")
    base: str = key("paper-25", "the scenario that all runs start from: a TOML file or a built-in one")
    scenario: dict[str, Any] = key(dict, "scenario keys that all variants share")
    sweep: SweepSettings = key(SweepSettings, "what varies, and how often it is repeated")
    sensitivity: SensitivitySettings | None = key(None, "keys drawn from ranges: each replicate has values of its own")

    def problems(self) -> Iterator[Problem]:
        """Check the name, which becomes part of a folder's name."""
        if not NAME.fullmatch(self.name):
            yield Problem("name", repr(self.name[:64]), "must be 1 to 48 ASCII letters, digits, '-' or '_'")


@dataclass(frozen=True)
class Variant:
    """One combination of the keys that vary."""

    label: str
    keys: Mapping[str, Any]
    """The swept keys, dotted, with this variant's values, and of a drawn choice its name."""
    scenario: Scenario

    @cached_property
    def identified(self) -> tuple[Inputs, dict[str, Any], list[str]]:
        """What decides its runs, read once: the inputs, the scenario's content, and the digests of its extensions.

        The inputs come first: a file that changes before the rest is read is then found to have changed.
        """
        inputs = identify(self.scenario)
        return inputs, content_of(self.scenario), [source.digest for source in sources(self.scenario)]


@dataclass(frozen=True)
class Job:
    """One run of a sweep."""

    variant: Variant
    replicate: int
    scenario: Scenario
    """The variant's, with the replicate's seed."""
    series_every_s: float

    @cached_property
    def key(self) -> str:
        """The key that identifies a finished run: scenario (except its name), extensions, windows, version of numpy."""
        _, content, extensions = self.variant.identified
        table = content | {"name": "", "seed": self.scenario.seed}
        text = json.dumps([table, self.series_every_s, extensions, version("numpy")], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    @property
    def inputs(self) -> Inputs:
        """The files that decide the run, as they were when the sweep began."""
        return self.variant.identified[0]

    @property
    def name(self) -> str:
        """The run's name, for people."""
        return f"{self.variant.label}, replicate {self.replicate}"


@dataclass(frozen=True)
class Sweep:
    """A whole sweep, checked."""

    file: SweepFile
    variants: Sequence[Variant]
    factors: Sequence[Sequence[str]] = ()
    """The labels of each axis, each paired table and the single variants; every combination is a variant."""
    points: Sequence[Sequence[Variant]] = ()
    """Of a sensitivity sweep, the variants at each point; `variants` are the first's.

    Replicates are numbered from point to point: with two runs per point, 0 and 1 are those of the first.
    """
    beside: Path = Path()
    """The folder from which file names in `file` start."""

    @property
    def scenarios(self) -> list[Scenario]:
        """The scenarios of all variants, at all points."""
        return [variant.scenario for variants in self.points or [self.variants] for variant in variants]

    @property
    def name(self) -> str:
        """The sweep's name, from its file."""
        return self.file.name

    @property
    def size(self) -> str:
        """The number of runs, for people."""
        numbers = list(self.repeats.values())
        times = " to ".join(map(str, dict.fromkeys([min(numbers), max(numbers)])))
        each = "replicates"
        if self.points:
            times, each = str(len(self.points)), f"points{f' x {self.runs_per_point}' * (self.runs_per_point > 1)}"
        return f"{self.name}: {len(numbers)} variants x {times} {each}, {sum(numbers)} runs"

    @property
    def runs_per_point(self) -> int:
        """The number of runs of each variant at a point of a sensitivity sweep; 1 in other sweeps."""
        return self.file.sensitivity.runs_per_point if self.file.sensitivity else 1

    @cached_property
    def repeats(self) -> dict[str, int]:
        """The number of runs of each variant, by label: replicates, or all runs at all points."""
        settings, each = self.file.sweep, self.runs_per_point
        return {one.label: each * settings.repeats_of.get(one.label, settings.repeats) for one in self.variants}

    @property
    def seeds(self) -> list[int]:
        """The seed of each replicate."""
        return [replicate_seed(self.file.sweep.seed, number) for number in range(max(self.repeats.values()))]

    @property
    def swept(self) -> list[str]:
        """The keys that vary, dotted, in the file's order."""
        return list(self.variants[0].keys)

    def jobs(self) -> list[Job]:
        """List all runs, first replicates first, so that the variants of an interrupted sweep can be compared."""
        every_s = self.file.sweep.series_every_s
        return [
            Job(variant, number, replace(variant.scenario, seed=seed), every_s)
            for number, seed in enumerate(self.seeds)
            for variant in (self.points[number // self.runs_per_point] if self.points else self.variants)
            if number < self.repeats[variant.label]
        ]

    def sample(self, jobs: Sequence[Job]) -> list[Job]:
        """Choose the runs that real processes do too: an arbitrary sample, the same each time."""
        provable = [job for job in jobs if job.scenario.run.bound == "none"]
        return sorted(provable, key=lambda job: job.key)[: self.file.sweep.prove]


def replicate_seed(sweep_seed: int, replicate: int) -> int:
    """Derive the seed of a replicate. It is the same in every variant, so that all variants see the same arrivals."""
    import numpy as np  # slow to import, and not needed to read a sweep file

    (state,) = np.random.SeedSequence([sweep_seed, replicate]).generate_state(1, np.uint64)
    return int(state) >> (64 - SEED_BITS)


def flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted names with their values, lists as JSON; a top-level `name` or `seed` is left out."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from flattened(value, f"{prefix}{name}.")
        elif f"{prefix}{name}" not in ("name", "seed"):  # the row's head identifies the run
            yield f"{prefix}{name}", cell(value)


def cell(value: Any) -> Any:
    """Return a value as a table holds it: lists and tables as JSON."""
    return orjson.dumps(value).decode() if isinstance(value, list | dict) else value
