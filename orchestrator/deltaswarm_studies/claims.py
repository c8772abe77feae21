"""Claims about the runs with their verdicts.

A trend is tested by the rank correlations of the replicates: where nothing differs they are symmetric about 0, so the
signed-rank test against 0 is exact but for ties, and then conservative.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from deltaswarm_studies import deciding, montecarlo, stats
from deltaswarm_studies.claim_settings import ANYWAY, DEPENDS, ClaimSettings, ClaimVerdict
from deltaswarm_studies.metrics import WAITING, WAITING_ALL
from deltaswarm_studies.stats import DIFFERENCE, RATIO, Contrast, Interval
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import Row, Samples, column, end, means_of, samples_of
from deltaswarm_studies.welch import Spread, Welch

TWINS = {WAITING: WAITING_ALL, WAITING_ALL: WAITING}
"""Two ways to count one outcome: without the events that were never sensed, and with them."""

OPPOSITE = {"holds": "refuted", "refuted": "holds"}


def claims_of(study: Study, runs: pd.DataFrame, *, is_whole: bool = True) -> pd.DataFrame:
    """Make a row per claim, with its verdict. Holm's correction is over all claims of the same source.

    A claim is about a region: ratios of at least a number, ratios within a margin, values within a tolerance. It holds
    if the interval lies in the region, is refuted if it lies outside, and is undecided otherwise. A published number
    with its spread is compared as a second sample: it agrees if the interval of the difference lies within the
    tolerance, differs if it excludes 0, and is undecided otherwise. The interval has the confidence at which Holm's
    procedure tests the claim; p is the two-sided p-value that agrees with it. Claims about all variants have no data
    unless the runs are whole.

    A claim about several rivals holds if it holds against each at the full level, and is refuted if one of them
    refutes it, corrected for their number. Its numbers are those of the rival that is closest to refuting it.

    What the median of its reference meets, too, holds anyway. What holds by one outcome and is refuted by another of
    the same question depends on the metric.
    """
    claims = [
        _TestedClaim(study, settings, runs if is_whole or settings.kind != "predicts" else runs.iloc[:0])
        for settings in study.file.claim
    ]
    rows: dict[str, Row] = {}
    for source in dict.fromkeys(claim.settings.source for claim in claims):
        family = [claim for claim in claims if claim.settings.source == source]
        for claim, (p_holm, alpha) in zip(family, stats.holm([claim.p for claim in family]), strict=True):
            rows[claim.settings.id] = claim.row(p_holm, alpha, len(family))
    by_question = defaultdict(list)
    for settings in study.file.claim:
        by_question[settings.question].append(rows[settings.id])
    for question, asked in by_question.items():
        verdicts = {"holds" if row["verdict"] in ("agrees", ANYWAY) else row["verdict"] for row in asked}
        if question and (DEPENDS in verdicts or ("holds" in verdicts and verdicts & {"refuted", "differs"})):
            for row in asked:
                if row["verdict"] not in ("undecided", "no data"):
                    row["verdict"] = DEPENDS
    return pd.DataFrame([rows[settings.id] for settings in study.file.claim])


class _TestedClaim:
    """A claim with the quantity that it is about: a value, a contrast, or the difference from a published number."""

    def __init__(self, study: Study, settings: ClaimSettings, runs: pd.DataFrame) -> None:
        self.study, self.settings, self._runs = study, settings, runs
        predicts = settings.kind == "predicts"
        samples = _correlations(runs, settings.metric) if predicts else samples_of(runs, settings.metric)
        self._contrast: Contrast | None = None
        self._values = np.zeros(0)
        self._welch: Welch | None = None
        self._least = settings.at_least
        self._p_within = 1.0
        self._rival = settings.more
        if settings.of:
            self._values = samples(settings.of).dropna().to_numpy(float)
            self._mcse = montecarlo.of_median(samples(settings.of))
            self.n, self.p = len(self._values), 1.0
            if self.n and settings.kind == "published":
                self._welch = self._compared()
                self._p_within = self._welch.p_within(*self._tolerance) if settings.within else 1.0
                self.p = min(self._welch.p(), self._p_within)
            elif self.n:
                self.p = stats.smallest_alpha(lambda alpha: self._verdict(alpha) != "undecided")
            return
        if settings.kind == "trend":
            correlations = _along(samples, settings.along)
            self._least = 0.0
            self._contrast = stats.contrast(correlations, 0 * correlations, DIFFERENCE)
            self._tails = self._contrast.p_above(0.0), self._contrast.p_below(0.0)
            self.n, self.p = self._contrast.n, self._contrast.p(0.0)
            self._mcse = montecarlo.of_shift(correlations, 0 * correlations, DIFFERENCE)
            return
        if settings.kind == "alike":
            self._test_alike(samples(settings.a), samples(settings.b))
        elif predicts:
            self._test_order([(settings.more, (samples(settings.more), samples(settings.less)))])
        else:
            self._test_order(list(_rivals(study, settings, samples)))

    def _test_alike(self, a: pd.Series, b: pd.Series) -> None:
        scale, expected = stats.scale_of(a, b), self.settings.ratio * b
        self._contrast = contrast = stats.contrast(a, b if scale == RATIO else expected, scale)
        self.n, self._mcse = contrast.n, montecarlo.of_shift(a, b if scale == RATIO else expected, scale)
        self._p_within, p_beyond = stats.p_of_margin(a, expected, self.settings.margin)
        self.p = min(self._p_within, p_beyond)

    def _test_order(self, rivals: "Sequence[tuple[str, Pair]]") -> None:
        by_mean = bool(self.settings.over)
        scale = stats.scale_of(*(side for _, pair in rivals for side in pair))
        pairs = [pair for _, pair in rivals]
        if scale != RATIO:  # a - r b above 0 says the same as a / b above r
            pairs, self._least = [(a, self.settings.at_least * b) for a, b in pairs], 0.0
        tested = [stats.contrast(a, b, scale, by_mean=by_mean) for a, b in pairs]
        above, below = zip(*((one.p_above(self._least), one.p_below(self._least)) for one in tested), strict=True)
        closest = above.index(max(above))
        self._rival, self._contrast = rivals[closest][0], tested[closest]
        self._tails = above[closest], min(1.0, len(below) * min(below))
        self.n, self.p = tested[closest].n, min(1.0, 2 * min(self._tails))
        self._mcse = montecarlo.of_shift(*pairs[closest], scale, by_mean=by_mean)

    def _compared(self) -> Welch:
        """Compare like with like: our median with a published one, or our mean."""
        settings = self.settings
        theirs = Spread(settings.published or 0.0, settings.published_error, settings.n)
        return Welch(Spread.of(self._values, is_median=bool(settings.iqr)), theirs)

    @property
    def _tolerance(self) -> Interval:
        """The differences from the published number that count as none."""
        low, high = self.settings.region
        return low - (self.settings.published or 0.0), high - (self.settings.published or 0.0)

    def _interval(self, alpha: float) -> Interval:
        tested = self._contrast or self._welch
        if tested is not None:
            return tested.interval(alpha)
        interval, error = stats.median_interval(self._values, alpha), self.settings.published_error
        return stats.with_error(float(np.median(self._values)), interval, error, alpha) if error else interval

    def _verdict(self, alpha: float) -> ClaimVerdict:
        if not self.n:
            return "no data"
        contrast = self._contrast
        if self._welch is not None:
            return "agrees" if self._p_within <= alpha else "differs" if self.p <= alpha else "undecided"
        if contrast is None:
            (low, high), (least, most) = self._interval(alpha), self.settings.region
            if least <= low and high <= most:
                return "holds"
            return "refuted" if high < least or low > most else "undecided"
        if self.p > alpha:
            return "undecided"
        if self.settings.kind == "alike":
            return "holds" if self._p_within <= alpha else "refuted"
        return "holds" if self._tails[0] < self._tails[1] else "refuted"

    def _in_context(self, alpha: float) -> ClaimVerdict:
        """Return the verdict beside that of the reference, and of the other way to count the outcome."""
        verdict, settings = self._verdict(alpha), self.settings
        if settings.reference and verdict in ("holds", "agrees"):
            least, most = settings.region
            without = samples_of(self._runs, settings.metric)(settings.reference).median()
            return ANYWAY if least <= without <= most else verdict
        twin = TWINS.get(settings.metric)
        if twin in self._runs and verdict in OPPOSITE and settings.kind != "predicts":
            other = _TestedClaim(self.study, replace(settings, metric=str(twin)), self._runs)
            return DEPENDS if other._verdict(alpha) == OPPOSITE[verdict] else verdict
        return verdict

    def _open(self, alpha: float, interval: Interval, verdict: ClaimVerdict, family: int) -> Row:
        """Say why the claim is undecided, and how many replicates would decide it."""
        welch, contrast, settings = self._welch, self._contrast, self.settings
        if verdict != "undecided":
            return {"open": "", "needed": None, "needed_of_both": None}
        if welch is not None:
            needed = welch.replicates(*self._tolerance, alpha)
            why = ("too few runs" if settings.within else "no margin") if needed else "cannot be closed"
            of_both = welch.replicates(*self._tolerance, alpha, of_both=True)
            return {"open": why, "needed": needed, "needed_of_both": of_both}
        few = "too few cells" if settings.over else "too few halves" if settings.best_of else "too few runs"
        if not all(map(math.isfinite, interval)):
            return {"open": few, "needed": stats.pairs_needed(family), "needed_of_both": None}
        least, most = settings.region
        found = float(np.median(self._values)) if contrast is None else contrast.estimate or 0.0
        if contrast is not None and contrast.scale == RATIO:
            found, least, most = math.log(found), math.log(least), math.log(most)
            interval = math.log(interval[0]), math.log(interval[1])
        elif contrast is not None:
            least, most = (math.nan if settings.kind == "alike" else self._least), math.nan
        edges = deciding.from_edges(found, [end for end in (least, most) if math.isfinite(end)])
        return {
            "open": few,
            "needed": deciding.runs_needed(interval, self.n, alpha, edges),
            "needed_of_both": None,
        }

    def row(self, p_holm: float, alpha: float, family: int) -> Row:
        """Return the claim's row, tested at `alpha` in a family of this many claims."""
        settings, contrast, welch = self.settings, self._contrast, self._welch
        low, high = self._interval(alpha) if self.n else (math.nan, math.nan)
        estimate = float(np.median(self._values)) if len(self._values) else None
        if welch is not None:
            estimate = welch.difference
        verdict = self._in_context(alpha)
        return {
            "claim": settings.id,
            **{name: getattr(settings, name) for name in ("text", "source", "says", "assumes", "metric")},
            "about": self._about(),
            "criterion": self._criterion(),
            "scale": contrast.scale if contrast else DIFFERENCE if settings.kind == "published" else "",
            "n": self.n,
            "ours": welch.ours.value if welch else None,
            "published": settings.published,
            "published_n": settings.n or None,
            "estimate": contrast.estimate if contrast else estimate,
            "low": end(low),
            "high": end(high),
            "mcse": self._mcse,
            "confidence": 1 - alpha,
            "effect": contrast.effect if contrast else None,
            "p": self.p if self.n else None,
            "p_holm": p_holm if self.n else None,
            "family": family,
            "verdict": verdict,
            **self._open(alpha, (low, high), verdict, family),
            "calibrated": ", ".join(settings.calibrated),
            "expect": settings.expected,
            "why": settings.why,
        }

    def _about(self) -> str:
        claim = self.settings
        if claim.of:
            return f"{claim.of} less the published" if claim.kind == "published" else claim.of
        if claim.along:
            return " to ".join(claim.along)
        is_difference = self._contrast is not None and self._contrast.scale == DIFFERENCE
        times = f"{claim.times:g} times " if is_difference and claim.times != 1 else ""
        return f"{claim.a or self._rival} over {times}{claim.b or claim.less}"

    def _criterion(self) -> str:
        claim, (low, high) = self.settings, self.settings.region
        if claim.kind == "alike":
            return f"{f'{claim.ratio:g} times, ' * (claim.ratio != 1)}within {claim.margin:g} times"
        if claim.kind == "trend":
            return "rising"
        if claim.kind in ("order", "predicts"):
            among = [f"each of {len(claim.every)}"] if claim.every else []
            among += [f"mean over {self.study.factor_title(claim.over)}"] if claim.over else []
            return ", ".join([f"at least {claim.at_least:g} times" if claim.at_least != 1 else "more", *among])
        if claim.kind == "published" and not claim.within:
            return "the same, without a margin"
        if math.isinf(high):
            return f"above {low:g}"
        exact = " (no spread published)" if claim.says and not claim.n else ""
        return f"{low:g} to {high:g}{exact}"


Pair = tuple[pd.Series, pd.Series]
"""Samples of the side that has more, and of the one that has less."""


def _rivals(study: Study, claim: ClaimSettings, samples: Samples) -> Iterator[tuple[str, Pair]]:
    """Yield each rival that an order names, with the samples of both sides; over a factor, means by level."""
    along = study.along(claim.over, claim.cells) if claim.over else {name: [name] for name in claim.variants}

    def paired(more: Sequence[str]) -> Pair:
        """Compare with these variants by level, or with the best of them."""
        rivals = zip(*(along.get(name, ()) for name in more), strict=False)
        pairs = [_of_the_best(samples, own, less) for own, less in zip(rivals, along.get(claim.less, ()), strict=False)]
        return means_of(pairs) if claim.over else pairs[0]

    for name in claim.every or [claim.more] * (not claim.best_of):
        yield name, paired([name])
    if claim.best_of:
        yield f"the best of {len(claim.best_of)}", paired(claim.best_of)


def _of_the_best(samples: Samples, rivals: Sequence[str], less: str) -> Pair:
    """Return the samples of the only rival, or in even replicates of the one with the lowest mean in odd ones."""
    if len(rivals) == 1:
        return samples(rivals[0]), samples(less)
    known = pd.concat([samples(name) for name in rivals], axis=1, keys=rivals).dropna(axis=1, how="all").dropna()
    odd = known.index % 2 == 1
    best = str(known[odd].mean().idxmin()) if odd.any() else rivals[0]
    even = samples(less).index % 2 == 0
    return samples(best)[even], samples(less)[even]


def _along(samples: Samples, variants: Sequence[str]) -> pd.Series:
    """Return each replicate's rank correlation (Spearman) of a metric with the order of the variants."""
    ranks = pd.concat([samples(name) for name in variants], axis=1).dropna().rank(axis=1)
    order = np.arange(len(variants)) - (len(variants) - 1) / 2
    away = ranks.sub(ranks.mean(axis=1), axis=0)
    size = np.sqrt((away**2).sum(axis=1) * (order**2).sum())
    return pd.Series(away.to_numpy() @ order / size, ranks.index).fillna(0.0)  # without a difference there is no order


def _correlations(runs: pd.DataFrame, metric: str) -> Samples:
    """Return a function from a predictor to the size of its rank correlation with a metric over the variants.

    Spearman's correlation, by replicate, which asks only how well one order follows from the other: in the same or in
    the opposite direction.
    """

    def by_variant(name: str) -> pd.DataFrame:
        return runs.assign(value=column(runs, name)).pivot_table("value", "variant", "replicate")

    outcomes = by_variant(metric)
    return lambda predictor: outcomes.rank().corrwith(by_variant(predictor).reindex_like(outcomes).rank()).abs()


def vacuous_claims(study: Study, runs: pd.DataFrame) -> list[str]:
    """List claims that no run of the study could contradict: their region is far wider than all runs differ."""
    problems = []
    for claim in study.file.claim:
        values = column(runs, claim.metric).dropna().to_numpy(float)
        if not len(values) or claim.kind in ("predicts", "trend") or math.isnan(claim.region[0]):
            continue
        (least, most), low, high = claim.region, values.min(), values.max()
        if claim.of:
            is_vacuous = least <= low and high <= most and 10 * (high - low) < most - least < math.inf
        else:
            widest = high / low if low > 0 else math.inf
            is_vacuous = widest < (1 / least if claim.kind == "order" else min(most, 1 / least))
        if is_vacuous:
            problems.append(f"the claim {claim.id!r} is vacuous: no run of any variant could contradict it")
    return problems
