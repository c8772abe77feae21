"""Contrasts: levels of a factor, compared within each combination of the others, and what a plan of them can show."""

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.sweeps.table import read_table
from deltaswarm_studies import montecarlo
from deltaswarm_studies.ceilings import at_ceiling
from deltaswarm_studies.claim_settings import DEPENDS
from deltaswarm_studies.claims import TWINS
from deltaswarm_studies.deciding import Open, open_contrast
from deltaswarm_studies.metrics import ID
from deltaswarm_studies.settings import ContrastSettings, ContrastVerdict
from deltaswarm_studies.stats import (
    RATIO,
    Contrast,
    Scale,
    contrast,
    holm,
    p_of_margin,
    pairs_needed,
    scale_of,
    smallest_effect,
)
from deltaswarm_studies.study import Comparison, Study
from deltaswarm_studies.tables import Row, Samples, end, means_of, samples_of

SIDES = {"higher": "higher", "slightly higher": "higher", "lower": "lower", "slightly lower": "lower"}
OPPOSITE = {"higher": "lower", "lower": "higher"}

CELLS: Open = "too few cells"

MIN_PILOT = 3
"""Fewest pairs of a pilot from which a spread is estimated."""


def contrasts_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per comparison. Each pair of contrast and metric is one family for Holm's correction.

    `level` is compared with `reference` within the cell `within`, all rows of a family on one scale. The interval has
    the confidence at which Holm's procedure tests the row, and decides the verdict: higher, lower, alike (within the
    margin), slightly higher or lower (different, and within the margin), unclear, or no data; and that it depends on
    the metric if waiting by the events that were sensed and by all events differ in opposite directions.
    """
    rows: list[Row] = []
    for settings in study.file.contrast:
        for metric in study.metrics_of(settings):
            twin = TWINS.get(metric)
            is_plain = not (settings.across or settings.over)
            twins = samples_of(runs, twin) if twin and twin in runs and is_plain else None
            rows += _family(settings, metric, list(study.comparisons(settings)), samples_of(runs, metric), twins)
    return pd.DataFrame(rows)


def _family(
    settings: ContrastSettings,
    metric: str,
    comparisons: Sequence[Comparison],
    samples: Samples,
    twins: Samples | None,
) -> Iterator[Row]:
    """Yield the rows of a family; `twins` are the same outcome by another count, whose order must not be opposite."""
    scale = _scale_of(comparisons, samples)
    margin, by_mean = settings.margin, bool(settings.over)
    pairs = [_paired(row, samples, scale, by_mean=by_mean) for row in comparisons]
    contrasts = [contrast(a, b, scale, by_mean=by_mean) for a, b in pairs]
    tests = holm([tested.p() for tested in contrasts])
    for row, (a, b), tested, (p_holm, alpha) in zip(comparisons, pairs, contrasts, tests, strict=True):
        has_margin = margin > 0 and (scale == RATIO or len(row.sides) == 1)  # changes by differences have no ratio
        p_within = p_of_margin(a, b, margin, by_mean=by_mean)[0] if has_margin else 1.0
        low, high = tested.interval(alpha)
        verdict, why, needed = _verdict(tested, alpha, p_within), "", None
        if twins and verdict in SIDES:
            other = contrast(*_paired(row, twins, _scale_of([row], twins)))
            is_opposite = _verdict(other, alpha, 1.0) == OPPOSITE[SIDES[verdict]]
            verdict = DEPENDS if is_opposite else verdict
        if verdict == "unclear":
            of = (tested.estimate or 0.0, (low, high), tested.n, alpha, scale, margin * has_margin)
            why, needed = open_contrast(*of, 0 if by_mean else len(contrasts))
            why = CELLS if by_mean and needed else why
        yield {
            "contrast": settings.id,
            "metric": metric,
            **{name: getattr(row, name) for name in ("level", "reference", "within")},
            "scale": scale,
            "n": tested.n,
            "missing": tested.missing,
            "estimate": tested.estimate,
            "low": end(low),
            "high": end(high),
            "mcse": montecarlo.of_shift(a, b, scale, by_mean=by_mean),
            "confidence": 1 - alpha,
            "effect": tested.effect,
            "p": tested.p(),
            "p_holm": p_holm,
            "family": len(contrasts),
            "margin": margin,
            "verdict": verdict,
            "open": why,
            "needed": needed,
        }


def _scale_of(comparisons: Sequence[Comparison], samples: Samples) -> Scale:
    return scale_of(*(samples(variant) for row in comparisons for side in row.sides for variant in side))


def _paired(row: Comparison, samples: Samples, scale: Scale, *, by_mean: bool = False) -> tuple[pd.Series, pd.Series]:
    """Return the paired samples of a comparison; of an interaction those of changes, on the same scale."""
    sides = [(samples(a), samples(b)) for a, b in row.sides]
    if by_mean:
        return means_of(sides)
    if len(sides) == 1:
        return sides[0]
    change, reference = (a / b if scale == RATIO else a - b for a, b in sides)
    return change, reference


def _verdict(tested: Contrast, alpha: float, p_within: float) -> ContrastVerdict:
    is_small = p_within <= alpha
    if not tested.n:
        return "no data"
    if tested.p() > alpha:
        return "alike" if is_small else "unclear"
    if tested.p_above() < tested.p_below():
        return "slightly higher" if is_small else "higher"
    return "slightly lower" if is_small else "lower"


def smallest_effects(study: Study, file: Path) -> dict[tuple[int, str], str | None]:
    """Describe the smallest effect of each contrast (by its place) and metric, from a pilot's `runs.csv`."""
    runs = read_table(file, ["variant"], needs=ID)
    return {
        (number, metric): _smallest_effect(study, settings, metric, runs)
        for number, settings in enumerate(study.file.contrast)
        for metric in study.metrics_of(settings)
    }


def _smallest_effect(study: Study, settings: ContrastSettings, metric: str, runs: pd.DataFrame) -> str | None:
    """Say which effect the replicates would show with a probability of 80 %, for the median spread of the family."""
    comparisons = list(study.comparisons(settings))
    if settings.over:
        return None
    repeats = study.repeats_of(itertools.chain(*(side for row in comparisons for side in row.sides)))
    if runs.empty or metric not in runs or repeats < pairs_needed(len(comparisons)):
        return None
    samples = samples_of(runs, metric)
    scale = _scale_of(comparisons, samples)
    stuck = {variant for name, variant in at_ceiling(study, runs) if name == metric}
    pairs = [_paired(row, samples, scale) for row in comparisons if stuck.isdisjoint(itertools.chain(*row.sides))]
    changes = [(np.log(a) - np.log(b) if scale == RATIO else a - b).dropna() for a, b in pairs]
    spreads = [float(change.std()) for change in changes if len(change) >= MIN_PILOT]
    if not spreads:
        return None
    shift = smallest_effect(float(np.median(spreads)), repeats, len(comparisons))
    return f"{math.exp(shift):.2f} times" if scale == RATIO else f"{shift:.3g} {study.metrics[metric].unit}".rstrip()
