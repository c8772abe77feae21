"""Rank tests by scipy.stats: exact where that can be had, with the effect size that belongs to each."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import stats

from deltaswarm_orchestrator.analysis.intervals import Array, is_constant

Alternative = Literal["two-sided", "less", "greater"]

EXACT_WITH_TIES = 10_000
"""With ties the exact null distribution has to be enumerated; beyond so many arrangements it is approximated."""
EXACT_WITHOUT_TIES = 50
"""Up to so many values (or pairs) the exact null distribution is cheap when there are no ties."""
NORMAL: Any = "asymptotic"
"""Any, since the stubs do not know this word everywhere."""

PAIRED_EFFECT = "matched-pairs rank-biserial"
UNPAIRED_EFFECT = "Cliff's delta"


@dataclass(frozen=True)
class RankTest:
    """What a rank test found. Both effect sizes are 2 s - 1, s the statistic as a share of the largest possible."""

    name: str
    statistic: float | None
    p: float
    """1 where there is no evidence: no values, or all equal."""
    effect: float | None
    """From -1 to 1, above 0 where the first sample is larger; None without values."""
    effect_name: str


def wilcoxon(differences: Array, alternative: Alternative) -> RankTest:
    """Wilcoxon's signed-rank test of differences against 0; those that are 0 are left out."""
    name = "Wilcoxon signed-rank"
    if not len(differences):
        return RankTest(f"{name}, no pairs", None, 1.0, None, PAIRED_EFFECT)
    moved = differences[differences != 0]
    if not len(moved):
        return RankTest(f"{name}, no pair differs", None, 1.0, 0.0, PAIRED_EFFECT)
    n = len(moved)
    has_ties = len(np.unique(np.abs(moved))) < n
    method: Any
    if not has_ties and n <= EXACT_WITHOUT_TIES:
        method, how = "exact", "exact"
    elif has_ties and 2**n <= EXACT_WITH_TIES:
        method, how = stats.PermutationMethod(n_resamples=EXACT_WITH_TIES), "exact with ties"
    else:
        method, how = NORMAL, "normal approximation"
    found = stats.wilcoxon(moved, zero_method="wilcox", correction=True, alternative=alternative, method=method)
    # Two-sided, scipy gives the smaller rank sum; the effect needs the positive one.
    positive = stats.wilcoxon(moved, zero_method="wilcox", alternative="greater", method=NORMAL)
    statistic = float(positive.statistic)
    effect = 2 * statistic / (n * (n + 1) / 2) - 1
    return RankTest(f"{name}, {how}", statistic, min(float(found.pvalue), 1.0), effect, PAIRED_EFFECT)


def mann_whitney(a: Array, b: Array, alternative: Alternative) -> RankTest:
    """Mann-Whitney's U test of two samples."""
    name = "Mann-Whitney U"
    if not len(a) or not len(b):
        return RankTest(f"{name}, no values", None, 1.0, None, UNPAIRED_EFFECT)
    both = np.concatenate((a, b))
    if is_constant(both):
        return RankTest(f"{name}, all values equal", len(a) * len(b) / 2, 1.0, 0.0, UNPAIRED_EFFECT)
    has_ties = len(np.unique(both)) < len(both)
    method: Any
    if not has_ties and max(len(a), len(b)) <= EXACT_WITHOUT_TIES:
        method, how = "exact", "exact"
    elif has_ties and math.comb(len(both), len(a)) <= EXACT_WITH_TIES:
        method, how = stats.PermutationMethod(n_resamples=EXACT_WITH_TIES), "exact with ties"
    else:
        method, how = NORMAL, "normal approximation"
    found = stats.mannwhitneyu(a, b, alternative=alternative, method=method)
    statistic = float(found.statistic)
    effect = 2 * statistic / (len(a) * len(b)) - 1
    return RankTest(f"{name}, {how}", statistic, min(float(found.pvalue), 1.0), effect, UNPAIRED_EFFECT)


def smallest_p(n_a: int, n_b: int, *, paired: bool) -> float:
    """The smallest two-sided p that so many values (paired: n_a pairs) can give: when all point one way."""
    arrangements = 2.0**n_a if paired else float(math.comb(n_a + n_b, n_a))
    return min(1.0, 2 / arrangements)
