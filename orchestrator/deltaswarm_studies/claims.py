"""Claims about the runs with their verdicts, and the findings that rest on claims and contrasts."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from deltaswarm_studies import montecarlo, stats
from deltaswarm_studies.settings import ClaimSettings, ClaimVerdict, listed
from deltaswarm_studies.stats import DIFFERENCE, RATIO, Contrast, Interval
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import Row, Samples, column, end, samples_of
from deltaswarm_studies.welch import Spread, Welch

NUMBER = r"\d+(?:\.\d+)?"
RATIOS = re.compile(rf"({NUMBER})(?:(?: to | or )({NUMBER}))? times")
SHARES = re.compile(rf"({NUMBER})(?: to ({NUMBER}))? % (?:more|fewer|less|longer|sooner|later)")
MEDIANS = re.compile(rf"({NUMBER})(?: s)? instead of ({NUMBER})")
"""Numbers in the text of a finding."""


def claims_of(study: Study, runs: pd.DataFrame, *, is_whole: bool = True) -> pd.DataFrame:
    """Make a row per claim, with its verdict. Holm's correction is over all claims of the same source.

    A claim is about a region: ratios of at least a number, ratios within a margin, values within a tolerance. It holds
    if the interval lies in the region, is refuted if it lies outside, and is undecided otherwise. A published number
    with its spread is compared as a second sample: it agrees if the interval of the difference lies within the
    tolerance, differs if it excludes 0, and is undecided otherwise. The interval has the confidence at which Holm's
    procedure tests the claim; p is the two-sided p-value that agrees with it. Claims about all variants have no data
    unless the runs are whole.
    """
    claims = [
        _TestedClaim(settings, runs if is_whole or settings.kind != "predicts" else runs.iloc[:0])
        for settings in study.file.claim
    ]
    rows: dict[str, Row] = {}
    for source in dict.fromkeys(claim.settings.source for claim in claims):
        family = [claim for claim in claims if claim.settings.source == source]
        for claim, (p_holm, alpha) in zip(family, stats.holm([claim.p for claim in family]), strict=True):
            rows[claim.settings.id] = claim.row(p_holm, alpha, len(family))
    return pd.DataFrame([rows[settings.id] for settings in study.file.claim])


class _TestedClaim:
    """A claim with the quantity that it is about: a value, a contrast, or the difference from a published number."""

    def __init__(self, settings: ClaimSettings, runs: pd.DataFrame) -> None:
        self.settings = settings
        predicts = settings.kind == "predicts"
        samples = _correlations(runs, settings.metric) if predicts else samples_of(runs, settings.metric)
        self._contrast: Contrast | None = None
        self._values = np.zeros(0)
        self._welch: Welch | None = None
        self._least = settings.at_least
        self._p_within = 1.0
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
        is_alike = settings.kind == "alike"
        a, b = map(samples, (settings.a, settings.b) if is_alike else (settings.more, settings.less))
        scale = stats.scale_of(a, b)
        if scale != RATIO and not is_alike:  # a - r b above 0 says the same as a / b above r
            b, self._least = settings.at_least * b, 0.0
        expected = settings.ratio * b
        self._contrast = contrast = stats.contrast(a, b if scale == RATIO else expected, scale)
        self.n, self._mcse = contrast.n, montecarlo.of_shift(a, b, scale)
        if not is_alike:
            self.p = contrast.p(self._least)
        else:
            self._p_within, p_beyond = stats.p_of_margin(a, expected, settings.margin)
            self.p = min(self._p_within, p_beyond)

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
        return "holds" if contrast.p_above(self._least) < contrast.p_below(self._least) else "refuted"

    def row(self, p_holm: float, alpha: float, family: int) -> Row:
        """Return the claim's row, tested at `alpha` in a family of this many claims."""
        settings, contrast, welch = self.settings, self._contrast, self._welch
        low, high = self._interval(alpha) if self.n else (math.nan, math.nan)
        estimate = float(np.median(self._values)) if len(self._values) else None
        verdict, needed, of_both = self._verdict(alpha), None, None
        if welch is not None:
            estimate = welch.difference
            if verdict == "undecided":
                needed = welch.replicates(*self._tolerance, alpha)
                of_both = welch.replicates(*self._tolerance, alpha, of_both=True)
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
            "needed": needed,
            "needed_of_both": of_both,
            "calibrated": ", ".join(settings.calibrated),
            "expect": settings.expected,
            "why": settings.why,
        }

    def _about(self) -> str:
        claim = self.settings
        if claim.of:
            return f"{claim.of} less the published" if claim.kind == "published" else claim.of
        return f"{claim.a or claim.more} over {claim.b or claim.less}"

    def _criterion(self) -> str:
        claim, (low, high) = self.settings, self.settings.region
        if claim.kind == "alike":
            return f"{f'{claim.ratio:g} times, ' * (claim.ratio != 1)}within {claim.margin:g} times"
        if claim.kind in ("order", "predicts"):
            return f"at least {claim.at_least:g} times" if claim.at_least != 1 else "more"
        if claim.kind == "published" and not claim.within:
            return "the same, without a margin"
        if math.isinf(high):
            return f"above {low:g}"
        exact = " (no spread published)" if claim.says and not claim.n else ""
        return f"{low:g} to {high:g}{exact}"


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
        if not len(values) or claim.kind == "predicts" or math.isnan(claim.region[0]):
            continue
        (least, most), low, high = claim.region, values.min(), values.max()
        if claim.of:
            is_vacuous = least <= low and high <= most and 10 * (high - low) < most - least < math.inf
        else:
            widest = high / low if low > 0 else math.inf
            is_vacuous = widest < (1 / least if claim.kind == "order" else most)
        if is_vacuous:
            problems.append(f"the claim {claim.id!r} is vacuous: no run of any variant could contradict it")
    return problems


def findings_of(study: Study, results: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Make a row per finding: the sentence, and what no longer supports it (empty if all does): results, numbers.

    `results` has the table of each kind of result: claims, contrasts, fits and estimates.
    """
    rows = []
    medians = list(results["estimates"]["median"]) if "estimates" in results else []
    for finding in study.file.finding:
        rested = [_rows_of(result, results) for result in finding.because]
        reasons = [reason for reason in map(_broken, finding.because, rested) if reason]
        estimates = [number for table in rested if "estimate" in table for number in table["estimate"].dropna()]
        wrong = list(unsupported(finding.text, estimates, medians))
        reasons += [f"no result that it rests on is {', '.join(map(repr, wrong))}"] if wrong and not reasons else []
        rows.append({"text": finding.text, "broken": "; ".join(reasons)})
    return pd.DataFrame(rows, columns=["text", "broken"])


def _rows_of(result: Mapping[str, Any], results: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    rows = next(table for kind, table in results.items() if kind in result)
    for name, value in result.items():
        rows = rows[rows[name].isin(listed(value))] if name != "is" else rows
    return rows


def _broken(result: Mapping[str, Any], rows: pd.DataFrame) -> str:
    """Say why the rows that a finding names do not support it; empty if they do."""
    named = {name: value for name, value in result.items() if name != "is"}
    what = ", ".join(f"{name} {value!r}" for name, value in named.items())
    if rows.empty:
        return f"there is no result with {what}"
    wrong = rows[~rows["verdict"].isin(listed(result["is"]))]
    return f"{what} is {wrong['verdict'].iloc[0]}, not {result['is']}" if len(wrong) else ""


def unsupported(text: str, estimates: Iterable[float], medians: Iterable[float]) -> Iterator[str]:
    """Yield each number in a finding's text that is not among the results, as written there.

    `0.5 to 0.7 times` must be ratios among the `estimates`, whichever side is above, `12 % more` the change that one of
    them is, and `65 instead of 409` two of the `medians`, all rounded as the words have them.
    """
    ratios = [side for ratio in estimates if ratio > 0 for side in (ratio, 1 / ratio)]
    shares = [abs(ratio - 1) * 100 for ratio in ratios]
    words = " ".join(text.split())
    for pattern, found in ((RATIOS, ratios), (SHARES, shares), (MEDIANS, list(medians))):
        for match in pattern.finditer(words):
            if not all(_is_among(stated, found) for stated in match.groups() if stated):
                yield match.group()


def _is_among(stated: str, found: Iterable[float]) -> bool:
    """Return whether a number, rounded to as many decimals as are stated, is the stated one."""
    decimals = len(stated.partition(".")[2])
    half = 0.5 * 10.0**-decimals
    return any(math.isclose(number, float(stated), rel_tol=0, abs_tol=half * (1 + 1e-9)) for number in found)
