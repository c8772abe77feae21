"""Judging a paper's claims by our own runs: values within a tolerance, orders and equivalences by tests.

All p-values of one report are corrected together by Holm's method. What a verdict means is the same for all claims:

- "holds": our estimate agrees, and where there is a test, its corrected p is below 0.05;
- "undecided": our estimate agrees but the test does not show it, or there are fewer than two values;
- "does not hold": our estimate disagrees.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from deltaswarm_orchestrator.analysis import words
from deltaswarm_orchestrator.analysis.report import Column, Mark, Table
from deltaswarm_orchestrator.analysis.statistics import Values, compare, describe, holm, tost

Verdict = Literal["holds", "undecided", "does not hold"]

ALPHA = 0.05
WORST_FIRST: tuple[Verdict, ...] = ("does not hold", "undecided", "holds")
MARKS: dict[Verdict, Mark] = {"holds": "good", "undecided": "unsure", "does not hold": "bad"}

COLUMNS = (
    Column("Claim"),
    Column("Where"),
    Column("The paper's", is_numeric=True),
    Column("Ours, 95 % interval", is_numeric=True),
    Column("The paper's lies in our interval"),
    Column("Verdict"),
    Column("Why"),
)


@dataclass(frozen=True)
class ValueClaim:
    """The paper gives a number; ours, the median of `ours`, is to lie within a tolerance, ends included."""

    name: str
    source: str
    """Where the paper says it, such as "Section 4.1"."""
    paper: float
    unit: str
    """The unit of the paper's number, ours and the tolerance."""
    ours: Values
    within: tuple[float, float]

    def __post_init__(self) -> None:
        low, high = self.within
        if not low <= high:
            raise ValueError(f"{self.name}: the tolerance goes from {low} to {high}")


@dataclass(frozen=True)
class OrderClaim:
    """The paper says that one quantity is smaller than another, perhaps by a factor at least.

    The test is whether `larger` exceeds `at_least_ratio` times `smaller` (1 by default), one-sided.
    """

    name: str
    source: str
    text: str
    """What the paper says, in a few words."""
    smaller: Values
    larger: Values
    paired: bool
    at_least_ratio: float | None = None
    unit: str = ""
    """Of both; shown where a ratio cannot be given, since not all values are above 0."""
    paper_ratio: float | None = None
    """How many times as large the paper has it."""

    def __post_init__(self) -> None:
        if self.at_least_ratio is not None and not self.at_least_ratio > 0:
            raise ValueError(f"{self.name}: the ratio is {self.at_least_ratio}; it must be above 0")


@dataclass(frozen=True)
class EquivalenceClaim:
    """The paper says that two quantities are alike: that they differ by less than a margin, in their unit."""

    name: str
    source: str
    text: str
    a: Values
    b: Values
    margin: float
    unit: str
    paired: bool


Claim = ValueClaim | OrderClaim | EquivalenceClaim


@dataclass(frozen=True)
class Judgement:
    """What became of a claim."""

    claim: Claim
    verdict: Verdict
    paper: str
    """The paper's value or statement."""
    ours: str
    """Our estimate with its interval and unit."""
    estimate: float | None
    """Median [the claim's unit]; ratio of medians, or the shift where there is none; shift [the claim's unit]."""
    low: float | None
    high: float | None
    in_interval: bool | None
    """Whether the paper's value lies within our interval; None where it gives none, or we have none."""
    p: float | None
    """As the test gave it; None for values."""
    p_holm: float | None
    """Corrected over all claims of the report."""
    effect: float | None
    """Of an order, of what the test asks, a claimed ratio included; of an equivalence, of any difference at all."""
    effect_name: str
    why: str
    """The reason, in a few words."""


def judge(claims: Sequence[Claim], *, seed: int = 0) -> list[Judgement]:
    """Judge claims together: those that do not hold first, then the undecided, then those that hold.

    Within a verdict they keep their order.

    Raises:
        ValueError: When paired values differ in number, a value is infinite, or a margin is not above 0.
    """
    found = [_judged(claim, seed) for claim in claims]
    tested = [index for index, judgement in enumerate(found) if judgement.p is not None]
    adjusted = holm([p for judgement in found if (p := judgement.p) is not None])
    for index, p in zip(tested, adjusted, strict=True):
        found[index] = _corrected(found[index], p, len(tested))
    return sorted(found, key=lambda judgement: WORST_FIRST.index(judgement.verdict))


def claims_table(judgements: Sequence[Judgement], caption: str = "") -> Table:
    """The judgements as a report's table, one row each."""
    rows = [
        (
            judgement.claim.name,
            judgement.claim.source,
            judgement.paper,
            judgement.ours,
            judgement.in_interval,
            judgement.verdict,
            judgement.why,
        )
        for judgement in judgements
    ]
    return Table(COLUMNS, rows, caption, [MARKS[judgement.verdict] for judgement in judgements])


def counted(judgements: Sequence[Judgement]) -> dict[Verdict, int]:
    """How many claims have each verdict, in the order of the table."""
    return {verdict: sum(judgement.verdict == verdict for judgement in judgements) for verdict in WORST_FIRST}


def _judged(claim: Claim, seed: int) -> Judgement:
    """The judgement before the correction: a verdict "holds" that a test has yet to confirm."""
    match claim:
        case ValueClaim():
            return _value(claim, seed)
        case OrderClaim():
            return _order(claim, seed)
        case EquivalenceClaim():
            return _equivalence(claim, seed)


def _value(claim: ValueClaim, seed: int) -> Judgement:
    ours = describe(claim.ours, seed=seed)
    low, high = claim.within
    tolerance = f"{words.number(low)} to {words.number(high)} {claim.unit}".rstrip()
    agrees = ours.median is not None and low <= ours.median <= high
    inside = None
    if ours.low is not None and ours.high is not None:
        inside = ours.low <= claim.paper <= ours.high
    return Judgement(
        claim=claim,
        verdict=_verdict(agrees, ours.n),
        paper=f"{words.number(claim.paper)} {claim.unit}".rstrip(),
        ours=_estimate(ours.median, ours.low, ours.high, claim.unit),
        estimate=ours.median,
        low=ours.low,
        high=ours.high,
        in_interval=inside,
        p=None,
        p_holm=None,
        effect=None,
        effect_name="",
        why=_few(ours.n) or f"median of {ours.n} {'within' if agrees else 'outside'} {tolerance}",
    )


def _order(claim: OrderClaim, seed: int) -> Judgement:
    smaller, larger = list(claim.smaller), list(claim.larger)
    least = 1.0 if claim.at_least_ratio is None else claim.at_least_ratio
    plain = compare(larger, smaller, paired=claim.paired, seed=seed)
    scaled = [None if value is None else least * value for value in smaller]
    test = compare(larger, scaled, paired=claim.paired, alternative="greater", seed=seed)
    n = min(test.n_a, test.n_b)
    ratio = plain.ratio is not None
    estimate, low, high = (
        (plain.ratio, plain.ratio_low, plain.ratio_high) if ratio else (plain.difference, plain.low, plain.high)
    )
    # The ratio is what the reader sees, the shift is what the test is about: both must agree.
    agrees = test.difference is not None and test.difference > 0 and (plain.ratio is None or plain.ratio >= least)
    asked = "" if claim.at_least_ratio is None else f" (at least {words.number(least, 2)} times)"
    direction = "as the paper says" if agrees else "not as the paper says"
    return Judgement(
        claim=claim,
        verdict=_verdict(agrees, n),
        paper=_paper_order(claim),
        ours=_estimate(estimate, low, high, "times" if ratio else f"{claim.unit} apart".strip()),
        estimate=estimate,
        low=low,
        high=high,
        in_interval=low <= claim.paper_ratio <= high if ratio and claim.paper_ratio and low and high else None,
        p=test.p,
        p_holm=None,
        effect=test.effect,
        effect_name=test.effect_name,
        why=_few(n) or f"{direction}; {test.test}, one-sided{asked}, n = {_n(test.n_a, test.n_b, claim.paired)}",
    )


def _paper_order(claim: OrderClaim) -> str:
    return claim.text if claim.paper_ratio is None else f"{claim.text} ({words.number(claim.paper_ratio, 2)} times)"


def _equivalence(claim: EquivalenceClaim, seed: int) -> Judgement:
    a, b = list(claim.a), list(claim.b)
    test = tost(a, b, claim.margin, paired=claim.paired, seed=seed)
    plain = compare(a, b, paired=claim.paired, seed=seed)
    n = min(test.n_a, test.n_b)
    agrees = test.difference is not None and abs(test.difference) < claim.margin
    margin = f"{words.number(claim.margin)} {claim.unit}".rstrip()
    differ = f"differ by {'less' if agrees else 'no less'} than {margin}"
    return Judgement(
        claim=claim,
        verdict=_verdict(agrees, n),
        paper=claim.text,
        ours=_estimate(plain.difference, plain.low, plain.high, f"{claim.unit} apart".strip()),
        estimate=plain.difference,
        low=plain.low,
        high=plain.high,
        in_interval=None,
        p=test.p,
        p_holm=None,
        effect=plain.effect,
        effect_name=f"{plain.effect_name} of any difference",
        why=_few(n) or f"{differ}; {test.test}, n = {_n(test.n_a, test.n_b, claim.paired)}",
    )


def _corrected(judgement: Judgement, p_holm: float, family: int) -> Judgement:
    verdict = judgement.verdict
    if verdict == "holds" and p_holm >= ALPHA:
        verdict = "undecided"
    effect = f", {judgement.effect_name} {words.number(judgement.effect, 2)}" if judgement.effect is not None else ""
    why = f"{judgement.why}, {words.p_equals(p_holm)} (Holm over {family}){effect}"
    return replace(judgement, verdict=verdict, p_holm=p_holm, why=why)


def _verdict(agrees: bool, n: int) -> Verdict:
    if n < 2:
        return "undecided"
    return "holds" if agrees else "does not hold"


def _few(n: int) -> str:
    return f"only {words.count(n, 'value')}" if n < 2 else ""


def _n(n_a: int, n_b: int, paired: bool) -> str:
    if paired:
        return words.count(n_a, "pair")
    return str(n_a) if n_a == n_b else f"{n_a} and {n_b}"


def _estimate(value: float | None, low: float | None, high: float | None, unit: str) -> str:
    text = words.with_interval(value, low, high)
    return text if value is None else f"{text} {unit}".rstrip()
