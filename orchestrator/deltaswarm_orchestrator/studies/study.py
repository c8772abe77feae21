"""Study files: TOML with a sweep and the questions about it. A file is checked as a whole before anything runs."""

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deltaswarm_orchestrator.run.scenario import files_in
from deltaswarm_orchestrator.studies.metrics import BUILT_IN as METRICS
from deltaswarm_orchestrator.studies.metrics import Metric, MetricSettings
from deltaswarm_orchestrator.sweeps.load import STUDY_FOLDERS, STUDY_TABLES, load_sweep, read_file
from deltaswarm_orchestrator.sweeps.plan import LABEL, Sweep
from deltaswarm_orchestrator.sweeps.table import flattened
from deltaswarm_wire import checked
from deltaswarm_wire.checked import Problem, SettingsError, key

COLLECTIONS = {folder.rpartition("/")[2]: list(files_in(folder)) for folder in STUDY_FOLDERS}
"""The built-in studies by the name of their folder. The studies of a folder are done one after the other."""

HOLDS, REFUTED, UNDECIDED = "holds", "refuted", "undecided"
HIGHER, LOWER, ALIKE, UNCLEAR = "higher", "lower", "alike", "unclear"


@dataclass(frozen=True)
class StudySettings:
    """The table `[study]`."""

    title: str = key("", "of the page (default: the file's name)")
    question: str = key("", "what the study asks, in a sentence or two")
    factors: dict[str, Any] = key(dict, "what varies, in the sweep's order: a name for each with its title")
    metrics: tuple[str, ...] = key(("waiting", "messages"), "names of metrics to tabulate, the main one first")
    from_s: float = key(0.0, "start of the time over which metrics with a time series are taken [s]", low=0)
    until_s: float | None = key(None, "end of that time [s]; default: the end of the run", low=0)
    window_s: float = key(300.0, "length of the windows of time in figures and for recovery [s]", above=0)


@dataclass(frozen=True)
class ContrastSettings:
    """A table `[[contrast]]`: levels of a factor, compared within each combination of the others."""

    id: str = key("", "by which findings refer to it")
    text: str = key("", "what is compared, in a few words")
    factor: str = key("", "the factor whose levels are compared")
    reference: str = key("", "compare each other level with this one")
    pairs: tuple[tuple[str, ...], ...] = key((), "instead: pairs of levels to compare")
    across: str = key("", "compare these contrasts between the levels of another factor (an interaction)")
    across_pairs: tuple[tuple[str, ...], ...] = key((), "which of its levels")
    metrics: tuple[str, ...] = key((), "names of metrics (default: all of the study)")
    margin: float = key(0.0, "differences below this count as none: a ratio such as 1.1; 0: not tested", low=0)


@dataclass(frozen=True)
class ClaimSettings:
    """A table `[[claim]]`: a statement about the runs that the study tests."""

    id: str = key("", "by which findings refer to it")
    text: str = key("", "the claim, in a sentence")
    source: str = key("", "who says so, and where")
    says: str = key("", "what the source says, as it says it")
    kind: str = key("order", "order, value or alike", choices=("order", "value", "alike"))
    metric: str = key("waiting", "the metric's name")
    less: str = key("", "of an order: the variant that has less")
    more: str = key("", "of an order: the variant that has more")
    at_least: float = key(1.0, "of an order: least ratio of more to less", above=0)
    of: str = key("", "of a value: the variant")
    within: tuple[float, ...] = key((), "of a value: the tolerance [metric's unit]")
    a: str = key("", "of alike: a variant")
    b: str = key("", "of alike: the other variant")
    margin: float = key(0.0, "of alike: they differ by less than this ratio (above 1)", low=0)
    expect: str = key(HOLDS, "the verdict that is no surprise", choices=(HOLDS, REFUTED, UNDECIDED))
    why: str = key("", "why it is expected not to hold, as far as is known")

    def problems(self) -> list[Problem]:
        """List what the claim's kind needs and does not have."""
        needed: dict[str, dict[str, Any]] = {
            "order": {"less": self.less, "more": self.more},
            "value": {"of": self.of, "within": len(self.within) == 2 and self.within[0] < self.within[1]},
            "alike": {"a": self.a, "b": self.b, "margin": self.margin > 1},
        }
        return [
            Problem(name, "missing or impossible", f"a claim of kind {self.kind!r} needs it")
            for name, value in {"id": self.id, "text": self.text, **needed[self.kind]}.items()
            if not value
        ]

    @property
    def variants(self) -> list[str]:
        """The variants that the claim is about."""
        return [name for name in (self.less, self.more, self.of, self.a, self.b) if name]


@dataclass(frozen=True)
class RecoverySettings:
    """A table `[[recovery]]`: how long a metric needs to recover after a fault."""

    metric: str = key("waiting_all", "the metric's name")
    factor: str = key("", "the factor that has the fault among its levels")
    level: str = key("", "the level with the fault")
    reference: str = key("", "the level without it: the same swarm to which nothing happened")
    after_s: float = key(0.0, "when it can begin to recover [s]", low=0)
    tolerance: float = key(1.25, "largest ratio to the reference that counts as recovered", above=1)
    windows: int = key(2, "number of consecutive windows in which it must be back", low=1)


@dataclass(frozen=True)
class SpanSettings:
    """A stretch of time that a figure marks."""

    text: str = key("", "what it is")
    from_s: float = key(0.0, "start [s]", low=0)
    until_s: float | None = key(None, "end [s]; default: the same as the start", low=0)


@dataclass(frozen=True)
class FigureSettings:
    """A table `[[figure]]`."""

    name: str = key("", "of its files")
    kind: str = key("boxes", "what is drawn", choices=("boxes", "levels", "time", "plane", "swarm"))
    caption: str = key("", "below the figure")
    metric: str = key("waiting", "of the vertical axis")
    x: str = key("", "boxes, levels: the factor along the axis; plane: the metric of the horizontal axis")
    hue: str = key("", "the factor told apart by colour")
    facet: str = key("", "the factor with a panel for each level")
    variants: tuple[str, ...] = key((), "only these, in this order")
    path: tuple[str, ...] = key((), "plane: variants whose medians are joined by a line, in this order")
    published: dict[str, Any] = key(dict, "boxes: a published median and interquartile range by level or variant")
    lines: dict[str, Any] = key(dict, "horizontal lines: what is written beside them, and where")
    spans: tuple[SpanSettings, ...] = key((), "time: stretches to mark")
    at_s: float = key(600.0, "swarm: the moment to draw [s]", low=0)
    seed: int = key(1, "swarm: the run's seed", low=0)


@dataclass(frozen=True)
class FindingSettings:
    """A table `[[finding]]`: a sentence written by a person, and the results that support it."""

    text: str = key("", "the sentence")
    because: tuple[dict[str, Any], ...] = key((), "results: {claim, is} or {contrast, metric, level, within, is}")


@dataclass(frozen=True)
class StudyFile:
    """The content of a study file besides its sweep."""

    study: StudySettings = key(StudySettings, "title, question, factors, metrics")
    metric: tuple[MetricSettings, ...] = key((), "metrics of the study's own")
    contrast: tuple[ContrastSettings, ...] = key((), "what is compared with what")
    claim: tuple[ClaimSettings, ...] = key((), "what is said and judged")
    recovery: tuple[RecoverySettings, ...] = key((), "times to come back after a fault")
    figure: tuple[FigureSettings, ...] = key((), "what is drawn")
    finding: tuple[FindingSettings, ...] = key((), "what follows, in words")


@dataclass(frozen=True)
class Study:
    """A complete, checked study."""

    name: str
    file: StudyFile
    sweep: Sweep
    factors: Mapping[str, Sequence[str]]
    """The levels of each factor, in order."""
    metrics: Mapping[str, Metric]
    """Every metric that may be named: the built-in ones and the study's own."""

    @property
    def title(self) -> str:
        """Title of the page."""
        return self.file.study.title or self.name

    @property
    def step_s(self) -> float:
        """Length of a step of the runs [s]."""
        return self.sweep.variants[0].scenario.run.step_s

    @property
    def repeats(self) -> int:
        """Replicates of each variant."""
        return self.sweep.file.sweep.repeats

    def factor_title(self, factor: str) -> str:
        """Return a factor's name for people."""
        return str(self.file.study.factors.get(factor, factor))

    def numbers(self, factor: str) -> dict[str, float]:
        """Return the number of each level of a factor; empty if the levels are not numbers."""
        return numbers_in(self.factors[factor])

    def metrics_of(self, contrast: ContrastSettings) -> Sequence[str]:
        """Return the metrics that a contrast is about."""
        return contrast.metrics or self.file.study.metrics


def load_study(
    name: str, overrides: Sequence[str] = (), settings: Mapping[str, int | float | None] | None = None
) -> Study:
    """Load the study of a file or a built-in name; `overrides` set scenario keys, `settings` keys of `[sweep]`.

    Raises:
        SettingsError: Every mistake in the sweep; if it has none, every mistake in the study's own tables.
    """
    sweep = load_sweep(name, overrides, settings)
    table, _ = read_file(name)
    file, problems = checked.check(StudyFile, {key: value for key, value in table.items() if key in STUDY_TABLES})
    if file is None:
        raise SettingsError(problems)
    return make_study(sweep.name, file, sweep)


def make_study(name: str, file: StudyFile, sweep: Sweep) -> Study:
    """Put a study together.

    Raises:
        SettingsError: Names of factors, levels, variants, metrics or results that do not exist.
    """
    names = list(file.study.factors) or default_factors(sweep)
    if len(names) != len(sweep.factors):
        count = f"{len(names)} names ({', '.join(names)})"
        raise SettingsError(
            [Problem("study.factors", count, f"must name the {len(sweep.factors)} things that this sweep varies")]
        )
    own = {metric.name: metric.made() for metric in file.metric}
    built_in = {name: metric.within(name, file.study.from_s, file.study.until_s) for name, metric in METRICS.items()}
    factors = dict(zip(names, sweep.factors, strict=True))
    study = Study(name, file, sweep, factors, {**built_in, **own})
    if problems := list(dict.fromkeys(_problems(study))):
        raise SettingsError(problems)
    return study


def default_factors(sweep: Sweep) -> list[str]:
    """Name each of a sweep's factors by the last part of the first key that it varies."""
    settings = sweep.file.sweep
    keys = [[name] for name, _ in flattened(settings.axes)]
    keys += [[name for name, _ in flattened(table) if name != LABEL] for table in settings.paired]
    names = [found[0].rpartition(".")[2] for found in keys]
    names += ["variant"] if len(names) < len(sweep.factors) else []
    return [name if names.count(name) == 1 else f"{name} {index + 1}" for index, name in enumerate(names)]


def numbers_in(levels: Sequence[str]) -> dict[str, float]:
    """Return the number of each level if all levels are swept numbers such as `loss=0.1`; else an empty dict."""
    try:
        return {level: float(level.partition("=")[2]) for level in levels}
    except ValueError:
        return {}


def _problems(study: Study) -> Iterator[Problem]:
    """Report names that refer to nothing."""
    for where, names, known in _references(study):
        allowed = ", ".join(map(repr, known)) or "declared, but none is"
        yield from (Problem(where, repr(name), f"must be one of {allowed}") for name in names if name not in known)


def _references(study: Study) -> Iterator[tuple[str, Sequence[str], Collection[str]]]:
    """Yield each place that refers to something by name: the place, its names, and the names that exist."""
    file, factors, metrics = study.file, study.factors, study.metrics
    variants = [variant.label for variant in study.sweep.variants]
    yield "study.metrics", file.study.metrics, metrics
    for i, contrast in enumerate(file.contrast):
        where, levels = f"contrast[{i}]", factors.get(contrast.factor, ())
        yield f"{where}.metrics", contrast.metrics, metrics
        yield f"{where}.factor", [contrast.factor], factors
        if contrast.reference:
            yield f"{where}.reference", [contrast.reference], levels
        else:
            yield f"{where}.pairs", [*itertools.chain(*contrast.pairs)] or [""], levels
        if contrast.across:
            yield f"{where}.across", [contrast.across], factors
            across = [*itertools.chain(*contrast.across_pairs)]
            yield f"{where}.across_pairs", across, factors.get(contrast.across, ())
    for i, claim in enumerate(file.claim):
        yield f"claim[{i}].metric", [claim.metric], metrics
        yield f"claim[{i}] ({claim.id})", claim.variants, variants
    for i, recovery in enumerate(file.recovery):
        yield f"recovery[{i}].metric", [recovery.metric], metrics
        yield f"recovery[{i}].factor", [recovery.factor], factors
        yield f"recovery[{i}].level", [recovery.level, recovery.reference], factors.get(recovery.factor, ())
    for i, figure in enumerate(file.figure):
        yield f"figure[{i}].metric", [figure.metric] if figure.kind != "swarm" else [], metrics
        yield f"figure[{i}].x", [figure.x] if figure.kind == "plane" else [], metrics
        named = [figure.hue, figure.facet, *([figure.x] if figure.kind in ("boxes", "levels") else [])]
        yield f"figure[{i}]", [name for name in named if name], factors
        yield f"figure[{i}].variants", [*figure.variants, *figure.path], variants
    known = {"claim": [claim.id for claim in file.claim], "contrast": [contrast.id for contrast in file.contrast]}
    for i, finding in enumerate(file.finding):
        for result in finding.because:
            kind = "claim" if "claim" in result else "contrast"
            yield f"finding[{i}].because", [str(result.get(kind, ""))], known[kind]
