"""Contrasts: levels of a factor, compared within each combination of the others."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.significance import ALPHA
from deltaswarm_orchestrator.stats import RATIO, Contrast, Scale, contrast, holm, scale_of
from deltaswarm_orchestrator.studies.metrics import WAITING, WAITING_ALL
from deltaswarm_orchestrator.studies.settings import (
    ALIKE,
    HIGHER,
    LOWER,
    NO_DATA,
    SLIGHTLY_HIGHER,
    SLIGHTLY_LOWER,
    UNCLEAR,
    ContrastSettings,
)
from deltaswarm_orchestrator.studies.study import Comparison, Study
from deltaswarm_orchestrator.studies.tables import Row, end, samples_of


def contrasts_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per comparison. Each pair of contrast and metric is one family for Holm's correction.

    `level` is compared with `reference` within the cell `within`, all rows of a family on one scale. The interval has
    the confidence at which Holm's procedure tests the row, and decides the verdict: higher, lower, alike (within the
    margin), slightly higher or lower (different, and within the margin), unclear, or no data.
    """
    rows: list[Row] = []
    for settings in study.file.contrast:
        for metric in study.metrics_of(settings):
            rows += _family(settings, metric, list(study.comparisons(settings)), samples_of(runs, metric))
    return pd.DataFrame(rows)


def _family(
    settings: ContrastSettings, metric: str, comparisons: Sequence[Comparison], of: Callable[[str], pd.Series]
) -> Iterator[Row]:
    scale = scale_of(*(of(variant) for row in comparisons for side in row.sides for variant in side))
    found = [contrast(*_paired(row, of, scale), scale) for row in comparisons]
    margin = settings.margin if scale == RATIO else 0.0
    for row, one, (p_holm, alpha) in zip(comparisons, found, holm([one.p() for one in found]), strict=True):
        low, high = one.interval(alpha)
        yield {
            "contrast": settings.id,
            "metric": metric,
            "level": row.level,
            "reference": row.reference,
            "within": row.within,
            "scale": scale,
            "n": one.n,
            "missing": one.missing,
            "estimate": one.estimate,
            "low": end(low),
            "high": end(high),
            "confidence": 1 - alpha,
            "effect": one.effect,
            "p": one.p(),
            "p_holm": p_holm,
            "family": len(found),
            "margin": margin,
            "verdict": _verdict(one, alpha, margin),
        }


def _paired(row: Comparison, of: Callable[[str], pd.Series], scale: Scale) -> tuple[pd.Series, pd.Series]:
    """Return the paired samples of a comparison; for an interaction, samples of changes on the same scale."""
    if len(row.sides) == 1:
        ((a, b),) = row.sides
        return of(a), of(b)
    one, other = ((of(a) / of(b) if scale == RATIO else of(a) - of(b)) for a, b in row.sides)
    return one, other


def _verdict(found: Contrast, alpha: float, margin: float) -> str:
    is_small = margin > 0 and found.p_within(margin) <= alpha
    if not found.n:
        return NO_DATA
    if found.p() > alpha:
        return ALIKE if is_small else UNCLEAR
    if found.p_above() < found.p_below():
        return SLIGHTLY_HIGHER if is_small else HIGHER
    return SLIGHTLY_LOWER if is_small else LOWER


def disagreements(study: Study, runs: pd.DataFrame) -> list[str]:
    """List comparisons of waiting whose direction reverses when events that were never sensed are counted too.

    A swarm that never finds the difficult events would look fast by the events that it did find.
    """
    found: list[str] = []
    if not {WAITING, WAITING_ALL} <= set(runs):
        return found
    for settings in study.file.contrast:
        if settings.across or not {WAITING, WAITING_ALL} & set(study.metrics_of(settings)):
            continue
        for row in study.comparisons(settings):
            ((a, b),) = row.sides
            by = [contrast(of(a), of(b)) for of in (samples_of(runs, name) for name in (WAITING, WAITING_ALL))]
            signs = {0 if one.estimate is None else int(np.sign(one.estimate - one.none)) for one in by}
            if signs == {-1, 1} and min(one.p() for one in by) < ALPHA:
                found.append(
                    f"{row.level} against {row.reference} ({row.within}): waiting by sensed events and by all events "
                    "rank them in opposite order"
                )
    return found
