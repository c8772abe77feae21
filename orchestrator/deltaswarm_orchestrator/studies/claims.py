"""Claims about the runs with their verdicts, and the findings that rest on claims and contrasts."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.stats import (
    MEDIAN_ERROR,
    RATIO,
    Contrast,
    Interval,
    contrast,
    holm,
    median_interval,
    scale_of,
    smallest_alpha,
    with_error,
)
from deltaswarm_orchestrator.studies.settings import (
    HOLDS,
    IS,
    NO_DATA,
    REFUTED,
    UNDECIDED,
    ClaimSettings,
    listed,
)
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_orchestrator.studies.tables import Row, column, end, samples_of


def claims_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per claim, with its verdict. Holm's correction is over all claims of the same source.

    A claim is about a region: ratios of at least a number, ratios within a margin, values within a tolerance. It holds
    if the interval lies in the region, is refuted if it lies outside, and is undecided otherwise. The interval has the
    confidence at which Holm's procedure tests the claim; p is the two-sided p-value that agrees with it.
    """
    claims = study.file.claim
    found = [_Judged(claim, runs) for claim in claims]
    rows: dict[str, Row] = {}
    for source in dict.fromkeys(claim.source for claim in claims):
        family = [one for one in found if one.claim.source == source]
        for one, (p_holm, alpha) in zip(family, holm([one.p for one in family]), strict=True):
            rows[one.claim.id] = one.row(p_holm, alpha, len(family))
    return pd.DataFrame([rows[claim.id] for claim in claims])


class _Judged:
    """A claim with the quantity that it is about: a value, or a contrast."""

    def __init__(self, claim: ClaimSettings, runs: pd.DataFrame) -> None:
        self.claim = claim
        of = samples_of(runs, claim.metric) if claim.kind != "predicts" else _correlations(runs, claim.metric)
        self._contrast: Contrast | None = None
        self._values = np.zeros(0)
        self._error = MEDIAN_ERROR * claim.iqr / math.sqrt(claim.n) if claim.n else 0.0
        self._least = claim.at_least
        if claim.kind == "value":
            self._values = of(claim.of).dropna().to_numpy(float)
            self.n = len(self._values)
            self.p = smallest_alpha(lambda alpha: self._verdict(alpha) != UNDECIDED) if self.n else 1.0
            return
        a, b = (of(claim.a), of(claim.b)) if claim.kind == "alike" else (of(claim.more), of(claim.less))
        scale = scale_of(a, b)
        if scale != RATIO and claim.kind != "alike":  # a - r b above 0 says the same as a / b above r
            b, self._least = claim.at_least * b, 0.0
        self._contrast = found = contrast(a, b, scale)
        self.n = found.n
        if claim.kind != "alike":
            self.p = found.p(self._least)
        else:
            self.p = min(found.p_within(claim.margin), found.p_beyond(claim.margin)) if scale == RATIO else 1.0

    def _interval(self, alpha: float) -> Interval:
        if self._contrast is not None:
            return self._contrast.interval(alpha)
        interval = median_interval(self._values, alpha)
        return with_error(float(np.median(self._values)), interval, self._error, alpha) if self._error else interval

    def _verdict(self, alpha: float) -> str:
        if not self.n:
            return NO_DATA
        found = self._contrast
        if found is None:
            (low, high), (least, most) = self._interval(alpha), self.claim.region
            if least <= low and high <= most:
                return HOLDS
            return REFUTED if high < least or low > most else UNDECIDED
        if self.p > alpha:
            return UNDECIDED
        if self.claim.kind != "alike":
            return HOLDS if found.p_above(self._least) < found.p_below(self._least) else REFUTED
        return HOLDS if found.p_within(self.claim.margin) <= alpha else REFUTED

    def row(self, p_holm: float, alpha: float, family: int) -> Row:
        """Return the claim's row, tested at `alpha` in a family of this many claims."""
        claim, found = self.claim, self._contrast
        low, high = self._interval(alpha) if self.n else (math.nan, math.nan)
        median = float(np.median(self._values)) if len(self._values) else None
        return {
            "claim": claim.id,
            "text": claim.text,
            "source": claim.source,
            "says": claim.says,
            "metric": claim.metric,
            "criterion": self._criterion(),
            "scale": found.scale if found else "",
            "n": self.n,
            "estimate": found.estimate if found else median,
            "low": end(low),
            "high": end(high),
            "confidence": 1 - alpha,
            "effect": found.effect if found else None,
            "p": self.p if self.n else None,
            "p_holm": p_holm if self.n else None,
            "family": family,
            "verdict": self._verdict(alpha),
            "expect": claim.expect,
            "why": claim.why,
        }

    def _criterion(self) -> str:
        claim, (low, high) = self.claim, self.claim.region
        if claim.kind == "alike":
            return f"within {claim.margin:g} times"
        if claim.kind in ("order", "predicts"):
            return f"at least {claim.at_least:g} times" if claim.at_least != 1 else "more"
        return f"above {low:g}" if math.isinf(high) else f"{low:g} to {high:g}"


def _correlations(runs: pd.DataFrame, metric: str) -> Callable[[str], pd.Series]:
    """Return a function from a predictor to its rank correlation with a metric over the variants, by replicate.

    Spearman's correlation, which asks only how well one order follows from the other.
    """
    outcomes = runs.assign(value=column(runs, metric)).pivot_table("value", "variant", "replicate")

    def of(predictor: str) -> pd.Series:
        predicted = runs.assign(value=column(runs, predictor)).pivot_table("value", "variant", "replicate")
        return outcomes.rank().corrwith(predicted.reindex_like(outcomes).rank())

    return of


def vacuous_claims(study: Study, runs: pd.DataFrame) -> list[str]:
    """List claims that no run of the study could contradict: their region is far wider than all runs differ."""
    found = []
    for claim in study.file.claim:
        values = column(runs, claim.metric).dropna().to_numpy(float)
        if not len(values) or claim.kind == "predicts":
            continue
        (least, most), low, high = claim.region, values.min(), values.max()
        if claim.kind == "value":
            is_vacuous = (
                least <= low and high <= most and most - least > 10 * (high - low) and math.isfinite(most - least)
            )
        else:
            widest = high / low if low > 0 else math.inf
            is_vacuous = widest < (1 / least if claim.kind == "order" else most)
        if is_vacuous:
            found.append(f"the claim {claim.id!r} is vacuous: no run of any variant could contradict it")
    return found


def findings_of(study: Study, results: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Make a row per finding: the sentence, and the results that no longer support it (empty if all do).

    `results` has the table of each kind of result: claims, contrasts and fits.
    """
    rows = []
    for finding in study.file.finding:
        broken = [told for result in finding.because if (told := _broken(result, results))]
        rows.append({"text": finding.text, "broken": "; ".join(broken)})
    return pd.DataFrame(rows, columns=["text", "broken"])


def _broken(result: Mapping[str, Any], results: Mapping[str, pd.DataFrame]) -> str:
    """Say why a result does not support a finding; empty if it does."""
    rows = next(table for kind, table in results.items() if kind in result)
    for name, value in result.items():
        if name != IS:
            rows = rows[rows[name].isin(listed(value))]
    named = ", ".join(f"{name} {value!r}" for name, value in result.items() if name != IS)
    if rows.empty:
        return f"there is no result with {named}"
    wrong = rows[~rows["verdict"].isin(listed(result[IS]))]
    return f"{named} is {wrong['verdict'].iloc[0]}, not {result[IS]}" if len(wrong) else ""
