"""The table `[[claim]]` of a study file, with the checks of its keys."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, get_args

from deltaswarm_studies.stats import MEDIAN_ERROR
from deltaswarm_wire.checked import Problem, key

ClaimVerdict = Literal[
    "holds", "refuted", "undecided", "no data", "agrees", "differs", "holds anyway", "depends on the metric"
]
"""Of a published number: it agrees within the tolerance, or differs; of other claims: it holds, or is refuted."""
VERDICTS: tuple[ClaimVerdict, ...] = get_args(ClaimVerdict)

ANYWAY: Literal["holds anyway"] = "holds anyway"
"""The median of the reference meets the criterion, too: of a rule, it is kept by doing nothing."""
DEPENDS: Literal["depends on the metric"] = "depends on the metric"
"""Two outcomes of one question contradict each other."""


OF_ORDER = ("every", "best_of", "over", "cells")
"""Keys that only an order has."""


@dataclass(frozen=True)
class ClaimSettings:
    """A table `[[claim]]`: a statement about the runs that the study tests."""

    id: str = key("", "by which findings refer to it")
    text: str = key("", "the claim, in a sentence")
    source: str = key("", "who says so, and where")
    says: str = key("", "what the source says, as it says it")
    kind: str = key(
        "order",
        "order: one variant has more than another; value: one within a tolerance; published: one against a published "
        "number with its spread; alike: two within a margin; predicts: the better of two predictors; trend: rising "
        "along variants",
        choices=("order", "value", "published", "alike", "predicts", "trend"),
    )
    metric: str = key("waiting", "the metric's name; of predicts: what is predicted")
    less: str = key("", "of an order: the variant that has less; of predicts: the metric that predicts worse")
    more: str = key("", "of an order: the variant that has more; of predicts: the metric that predicts better")
    every: tuple[str, ...] = key(
        (),
        "of an order, instead of more: variants of which each has more; all must be shown to, each at the full level",
    )
    best_of: tuple[str, ...] = key(
        (),
        "of an order, instead of more: the variant with the lowest mean in the odd replicates; the sides are compared "
        "in the even ones",
    )
    over: str = key(
        "",
        "of an order: average over the levels of this factor, each of which counts once; variants are then named "
        "without its level",
    )
    cells: tuple[str, ...] = key((), "over: only these of its levels (default: all)")
    at_least: float = key(1.0, "of an order: least ratio of more to less", above=0)
    of: str = key("", "of a value or published: the variant")
    within: tuple[float, ...] = key(
        (), "of a value: the tolerance, two numbers [metric's unit]; of published: where it counts as agreeing"
    )
    above: float | None = key(None, "of a value, instead of the tolerance: the value is higher than this")
    published: float | None = key(None, "of published: the number [metric's unit], a median if its iqr is given")
    iqr: float = key(0.0, "of a value or published: the interquartile range that the source gives; 0: none", low=0)
    sd: float = key(0.0, "of published, instead: the standard deviation", low=0)
    se: float = key(0.0, "of published, instead: the standard error of the mean", low=0)
    n: int = key(0, "the replicates behind the source's number, if it gives a spread", low=0)
    assumes: str = key("", "what is assumed about the source's number, such as its n where it gives two")
    calibrated: tuple[str, ...] = key(
        (),
        "keys of the scenario, or metrics, that were chosen so that this number agrees: its agreement is no evidence",
    )
    a: str = key("", "of alike: a variant")
    b: str = key("", "of alike: the other variant")
    margin: float = key(0.0, "of alike: they differ by less than this ratio (above 1)", low=0)
    ratio: float = key(1.0, "of alike: not 1 but this ratio of a to b, to within the margin", above=0)
    along: tuple[str, ...] = key((), "of a trend: three or more variants, in the order in which the metric rises")
    reference: str = key(
        "", "of a value or published: the variant without the rule; if it meets the criterion, too, nothing is shown"
    )
    question: str = key("", "a name that claims share which are outcomes of one question: they must not contradict")
    expect: str = key("holds", "the verdict that you expect", choices=VERDICTS)
    why: str = key("", "why it is expected not to hold, as far as is known")

    def problems(self) -> Iterator[Problem]:
        """List what the claim's kind needs and does not have."""
        has_tolerance = len(self.within) == 2 and self.within[0] < self.within[1]
        needed: dict[str, dict[str, Any]] = {
            "order": {
                "less": self.less,
                "more": sum(map(bool, (self.more, self.every, self.best_of))) == 1,
                "over": self.over or not self.cells,
            },
            "value": {"of": self.of, "within": has_tolerance != (self.above is not None)},
            "published": {"of": self.of, "published": self.published is not None},
            "alike": {"a": self.a, "b": self.b, "margin": self.margin > 1},
            "predicts": {"less": self.less, "more": self.more},
            "trend": {"along": len(self.along) > 2},
        }
        for name, value in {"id": self.id, "text": self.text, **needed[self.kind]}.items():
            if not value:
                yield Problem(name, "missing or impossible", f"a claim of kind {self.kind!r} needs it")
        if self.ratio != 1 and self.kind != "alike":
            yield Problem(
                "ratio", f"{self.ratio:.15g}", f"must not be given for a claim of kind {self.kind!r}: only for 'alike'"
            )
        if self.kind != "order" and (given := [name for name in OF_ORDER if getattr(self, name)]):
            yield Problem(given[0], repr(getattr(self, given[0]))[:60], "must be left out: only an order has it")
        if self.reference and not self.of:
            yield Problem(
                "reference", repr(self.reference), "must be left out: only a value or a published number has it"
            )
        yield from self._spread_problems()
        names = [*(self.named or self.predictors), *([self.reference] if self.reference else [])]
        if len(set(names)) < len(names):
            name = {"alike": "b", "trend": "along"}.get(self.kind, "reference" if self.reference else "more")
            yield Problem(name, names[0], "must be another one")

    def _spread_problems(self) -> Iterator[Problem]:
        """Check that a spread comes with its number of replicates."""
        spreads = {name: value for name in ("iqr", "sd", "se") if (value := getattr(self, name))}
        got = ", ".join(f"{name} {value:.15g}" for name, value in {**spreads, "n": self.n}.items())
        if self.kind != "published":
            if bool(self.iqr) != bool(self.n):
                yield Problem("iqr", f"iqr {self.iqr:.15g}, n {self.n}", "must be given together with n")
            if {"sd", "se"} & set(spreads) or self.published is not None:
                yield Problem("kind", repr(self.kind), "must be 'published' for a published number with sd or se")
            return
        if len(spreads) != 1 or self.n < 2:
            allowed = "must be one of iqr, sd and se, with an n of at least 2; without them no two samples can be "
            yield Problem("n", got, allowed + "compared, only a value with a tolerance (kind 'value')")
        if self.above is not None:
            yield Problem("above", f"{self.above:.15g}", "must not be given for a published number: use within")
        if self.within and not (len(self.within) == 2 and self.within[0] < (self.published or 0.0) < self.within[1]):
            yield Problem("within", repr(list(self.within)), "must be two numbers with the published one between them")

    @property
    def published_error(self) -> float:
        """The standard error of the published number; 0 if its source gives no spread."""
        return (MEDIAN_ERROR * self.iqr or self.sd) / math.sqrt(self.n) if self.n and not self.se else self.se

    @property
    def named(self) -> list[str]:
        """The variants that the claim names; those over the levels of a factor lack its level."""
        if self.kind == "predicts":
            return []
        names = self.less, self.more, *self.every, *self.best_of, self.of, self.a, self.b, *self.along
        return [name for name in names if name]

    @property
    def variants(self) -> list[str]:
        """The variants that the claim is about; empty: all of the study, or many."""
        return [] if self.over else self.named

    @property
    def predictors(self) -> list[str]:
        """The metrics that `predicts` compares."""
        return [name for name in (self.less, self.more) if name] if self.kind == "predicts" else []

    @property
    def times(self) -> float:
        """Of an order or alike: with how many times the other side one is compared."""
        return self.ratio if self.kind == "alike" else self.at_least

    @property
    def region(self) -> tuple[float, float]:
        """Where the tested quantity must be: a ratio of `more` to `less` or of `a` to `b`, or a value."""
        if self.kind in ("order", "predicts"):
            return self.at_least, math.inf
        if self.kind == "alike":
            return self.ratio / self.margin, self.ratio * self.margin
        if self.above is not None:
            return self.above, math.inf
        return (self.within[0], self.within[1]) if self.within else (math.nan, math.nan)

    @property
    def expected(self) -> str | None:
        """The expected verdict, by its name for this kind of claim."""
        return expected_of(self.kind, self.expect)

    @property
    def verdicts(self) -> tuple[str, ...]:
        """The verdicts that a claim of this kind can have, from the best to the worst, besides that it has no data."""
        anyway = (ANYWAY,) if self.reference else ()
        if self.kind != "published":
            return "holds", *anyway, "undecided", DEPENDS, "refuted"
        return ("agrees", *anyway, "undecided", DEPENDS, "differs") if self.within else ("undecided", "differs")


def expected_of(kind: str | None, expect: str | None) -> str | None:
    """Return the name that an expected verdict has for a kind of claim: what is published agrees rather than holds."""
    return {"holds": "agrees", "refuted": "differs"}.get(expect or "", expect) if kind == "published" else expect
