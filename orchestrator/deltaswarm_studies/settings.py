"""The tables of a study file besides its sweep, each with the checks of its own keys."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any, Literal

from deltaswarm_studies.claim_settings import ClaimSettings
from deltaswarm_studies.event_settings import HORIZON_DOC, RingsSettings, SurvivalSettings
from deltaswarm_studies.kinds import KINDS
from deltaswarm_studies.metrics import MetricSettings
from deltaswarm_wire.checked import Problem, key
from deltaswarm_wire.reading import FILE_NAME_RULE, is_file_name

ContrastVerdict = Literal[
    "higher", "lower", "alike", "unclear", "slightly higher", "slightly lower", "depends on the metric", "no data"
]
"""Slightly higher or lower: there is a difference, and it is within the margin."""
FitVerdict = Literal["closest", "farther", "no data"]

RESULT_KEYS = {"claim": (), "contrast": ("metric", "level", "reference", "within"), "fit": ()}
"""What can be named of a result in a finding, by its kind. A value may be a list."""

Pairs = tuple[tuple[str, ...], ...]

PROTOCOL = "protocol.json"
"""The file that says what a study asked before its runs, beside its page."""

CONFIRMATORY, EXPLORATORY = "confirmatory", "exploratory"


@dataclass(frozen=True)
class StudySettings:
    """The table `[study]`."""

    title: str = key("", "of the page (default: the file's name)")
    question: str = key("", "what the study asks, in a sentence or two")
    kind: str = key(
        CONFIRMATORY,
        "confirmatory: it judges what was fixed before its runs (--freeze); exploratory: it looks for what to ask",
        choices=(CONFIRMATORY, EXPLORATORY),
    )
    replaces: dict[str, Any] = key(
        dict, "frozen studies in folders beside this one's that it asks anew, each with the reason in a sentence"
    )
    factors: dict[str, Any] = key(dict, "what varies, in the sweep's order: a name for each with its title")
    metrics: tuple[str, ...] = key(("waiting", "messages"), "names of metrics to tabulate, the main one first")
    words: dict[str, str] = key(
        dict, 'levels in a sentence, with a preposition: { "no recruitment" = "without recruitment" }; default: "with"'
    )
    from_s: float = key(0.0, "start of the time over which metrics with a time series are taken [s]", low=0)
    until_s: float | None = key(None, "end of that time [s]; default: the end of the run", low=0)
    window_s: float = key(300.0, "length of the windows of time in figures and for recovery [s]", above=0)
    max_events: int = key(100_000, "maximum number of rows of `events.csv`: whole replicates, from the first", low=0)

    def problems(self) -> Iterator[Problem]:
        """A study that is replaced needs a reason."""
        for name, reason in self.replaces.items():
            if not (isinstance(reason, str) and reason.strip()):
                yield Problem(f"replaces.{name}", repr(reason)[:60], "must be a sentence that says why")


@dataclass(frozen=True)
class ContrastSettings:
    """A table `[[contrast]]`: levels of a factor, compared within each combination of the others."""

    id: str = key("", "by which findings refer to it")
    text: str = key("", "what is compared, in a few words")
    factor: str = key("", "the factor whose levels are compared")
    reference: str = key("", "compare each other level with this one")
    pairs: Pairs = key((), "instead: pairs of levels to compare")
    over: str = key("", "average the comparisons over the levels of another factor, as claims do (`claim.over`)")
    cells: tuple[str, ...] = key((), "over: only these of its levels (default: all)")
    across: str = key("", "compare these contrasts between the levels of another factor (an interaction)")
    across_pairs: Pairs = key((), "across: pairs of its levels")
    metrics: tuple[str, ...] = key((), "names of metrics (default: all of the study)")
    margin: float = key(0.0, "differences below this count as none: a ratio above 1, such as 1.1; 0: not tested", low=0)

    def problems(self) -> Iterator[Problem]:
        """List what is missing or impossible."""
        if not self.id:
            yield Problem("id", "missing", "findings refer to it by its id")
        for name, pairs in (("pairs", self.pairs), ("across_pairs", self.across_pairs)):
            for i, pair in enumerate(pairs):
                if len(pair) != 2 or pair[0] == pair[1]:
                    yield Problem(f"{name}[{i}]", repr(list(pair))[:60], "must be two different levels")
        if self.margin != 0 and not self.margin > 1:
            yield Problem("margin", f"{self.margin:.15g}", "must be a ratio above 1, or 0")
        if bool(self.reference) == bool(self.pairs):
            yield Problem("reference", "both" if self.pairs else "neither", "must be given, or else pairs")
        if self.over and self.across:
            yield Problem("over", repr(self.over), "must be left out of an interaction (across)")
        if self.cells and not self.over:
            yield Problem("over", "missing", "must name the factor of cells")
        if self.across and not self.across_pairs:
            yield Problem("across_pairs", "missing", "an interaction must name pairs of levels of `across`")
        if self.across_pairs and not self.across:
            yield Problem("across", "missing", "must name the factor of across_pairs")


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
class TargetSettings:
    """A published number that runs should come close to."""

    level: str = key("", "of the fit's factor")
    metric: str = key("", "the metric's name")
    says: float = key(0.0, "the published median")
    iqr: float = key(1.0, "the published interquartile range, the unit of the distance", above=0)


@dataclass(frozen=True)
class FitSettings:
    """A table `[[fit]]`: how far the medians of each combination of the other factors are from published numbers."""

    text: str = key("", "what is fitted, in a few words")
    factor: str = key("", "the factor whose levels the targets name")
    targets: tuple[TargetSettings, ...] = key((), "published numbers")

    def problems(self) -> Iterator[Problem]:
        """There must be something to come close to."""
        if not self.targets:
            yield Problem("targets", "none", "a fit needs at least one")


@dataclass(frozen=True)
class GridSettings:
    """A table `[[grid]]`: a metric's medians, with a row per level of one factor and columns of levels of another."""

    text: str = key("", "what is shown, in a few words")
    metric: str = key("waiting", "the metric's name")
    rows: str = key("", "the factor with a row for each level")
    factor: str = key("", "the factor whose levels the columns name; the sweep may vary no third one")
    columns: dict[str, Any] = key(dict, "by heading, a list of levels, of which each row shows the lowest median")

    def problems(self) -> Iterator[Problem]:
        """Each column must list levels."""
        if not self.columns:
            yield Problem("columns", "none", "a grid needs at least one")
        for name, value in self.columns.items():
            if not _is_list_of_names(value):
                yield Problem(f"columns.{name}", repr(value)[:60], "must be a list of levels")


@dataclass(frozen=True)
class SpanSettings:
    """A stretch of time that a figure marks."""

    text: str = key("", "what it is")
    from_s: float = key(0.0, "start [s]", low=0)
    until_s: float | None = key(None, "end [s]; default: the same as the start", low=0)
    levels: tuple[str, ...] = key((), "of the facet: where it is so (default: in all panels)")


@dataclass(frozen=True)
class FigureSettings:
    """A table `[[figure]]`."""

    name: str = key("", "name of its files, without a suffix")
    kind: str = key("boxes", "; ".join(f"{name}: {kind.about}" for name, kind in KINDS.items()), choices=tuple(KINDS))
    caption: str = key("", "below the figure")
    metric: str = key("waiting", "the metric of the vertical axis; time: one with a time series")
    x: str = key("", "boxes, levels: the factor along the axis; plane, frontier: the metric of the horizontal axis")
    hue: str = key("", "the factor told apart by colour")
    facet: str = key("", "the factor with a panel for each level")
    variants: tuple[str, ...] = key((), "show only these variants, in this order (default: all)")
    path: tuple[str, ...] = key((), "plane: variants whose medians are joined by a line, in this order")
    paths: dict[str, Any] = key(dict, "frontier: variants whose medians are joined by a line, a list for each name")
    published: dict[str, Any] = key(dict, "boxes: a published median and interquartile range by level or variant")
    lines: dict[str, Any] = key(dict, "horizontal lines: by text, a number, or a variant for its median")
    spans: tuple[SpanSettings, ...] = key((), "time: stretches to mark")
    horizon_s: float | None = key(None, f"survival, rings: {HORIZON_DOC}", above=0)
    rings: int = key(5, "rings: number of rings, each with the same number of events", low=2, high=50)
    at_s: float = key(600.0, "swarm: the moment to draw [s]", low=0)
    seed: int = key(1, "swarm: the run's seed", low=0, high=2**63 - 1)

    def problems(self) -> Iterator[Problem]:
        """List tables with values of the wrong form, what the figure lacks, and what it would not show."""
        if not is_file_name(self.name):
            yield Problem("name", repr(self.name[:60]) if self.name else "missing", FILE_NAME_RULE)
        forms: tuple[tuple[str, Callable[[Any], bool], str], ...] = (
            ("published", _is_pair_of_numbers, "must be a list of a median and an interquartile range"),
            ("lines", lambda value: _is_number(value) or isinstance(value, str), "must be a number, or a variant"),
            ("paths", _is_list_of_names, "must be a list of variants"),
        )
        for table, is_well_formed, allowed in forms:
            for name, value in getattr(self, table).items():
                if not is_well_formed(value):
                    yield Problem(f"{table}.{name}", repr(value)[:60], allowed)
        kind, default = KINDS[self.kind], type(self)
        for name in kind.needs:
            if not getattr(self, name):
                yield Problem(name, "missing", f"a figure of kind {self.kind!r} needs it")
        for spec in fields(self):
            value = getattr(self, spec.name)
            if spec.name not in kind.keys and value and value != getattr(default, spec.name, None):
                yield Problem(spec.name, repr(value)[:60], f"must be left out: kind {self.kind!r} does not show it")


def listed(value: Any) -> list[Any]:
    """Return a list as it is, and any other value as a list of one."""
    return value if isinstance(value, list) else [value]


@dataclass(frozen=True)
class FindingSettings:
    """A table `[[finding]]`: results that a page states first; the sentences are made from them."""

    heading: str = key("", "what they are about, in a few words")
    results: tuple[dict[str, Any], ...] = key(
        (),
        "a sentence for each metric: {contrast, metric, level, reference, within}, {claim} or {fit}; values or lists",
    )
    remark: str = key("", "what a reader needs besides, such as a definition: no result and no comparison")

    def problems(self) -> Iterator[Problem]:
        """List results that name no claim or contrast, or something else."""
        if not self.heading:
            yield Problem("heading", "missing", "a finding needs a heading")
        if not self.results:
            yield Problem("results", "missing", "a finding must name results")
        for i, result in enumerate(self.results):
            where = f"results[{i}]"
            kinds = [kind for kind in RESULT_KEYS if kind in result]
            if len(kinds) != 1:
                yield Problem(where, ", ".join(result) or "nothing", "must name one claim, contrast or fit")
                continue
            for name in result:
                if name not in (kinds[0], *RESULT_KEYS[kinds[0]]):
                    known = ", ".join((kinds[0], *RESULT_KEYS[kinds[0]]))
                    yield Problem(f"{where}.{name}", "unknown key", f"known are {known}")


@dataclass(frozen=True)
class StudyFile:
    """The content of a study file besides its sweep."""

    study: StudySettings = key(StudySettings, "title, question, factors, metrics")
    metric: tuple[MetricSettings, ...] = key((), "metrics of the study's own")
    contrast: tuple[ContrastSettings, ...] = key((), "what is compared with what")
    claim: tuple[ClaimSettings, ...] = key((), "what is said and judged")
    recovery: tuple[RecoverySettings, ...] = key((), "times to come back after a fault")
    fit: tuple[FitSettings, ...] = key((), "distances to published numbers")
    grid: tuple[GridSettings, ...] = key((), "medians by two factors")
    survival: tuple[SurvivalSettings, ...] = key((), "times until a moment of events")
    rings: tuple[RingsSettings, ...] = key((), "times until a moment of events, by distance")
    figure: tuple[FigureSettings, ...] = key((), "what is drawn")
    finding: tuple[FindingSettings, ...] = key((), "what follows, in words")


def _is_list_of_names(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(name, str) for name in value)


def _is_pair_of_numbers(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
