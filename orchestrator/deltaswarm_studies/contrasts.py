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
from deltaswarm_studies.metrics import ID, WAITING, WAITING_ALL
from deltaswarm_studies.settings import ContrastSettings, ContrastVerdict
from deltaswarm_studies.stats import (
    ALPHA,
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
from deltaswarm_studies.tables import Row, Samples, end, samples_of

MIN_PILOT = 3
"""Fewest pairs of a pilot from which a spread is estimated."""


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
    settings: ContrastSettings, metric: str, comparisons: Sequence[Comparison], samples: Samples
) -> Iterator[Row]:
    scale = _scale_of(comparisons, samples)
    pairs = [_paired(row, samples, scale) for row in comparisons]
    contrasts = [contrast(a, b, scale) for a, b in pairs]
    margin = settings.margin
    tests = holm([tested.p() for tested in contrasts])
    for row, (a, b), tested, (p_holm, alpha) in zip(comparisons, pairs, contrasts, tests, strict=True):
        has_margin = margin > 0 and (scale == RATIO or len(row.sides) == 1)  # changes by differences have no ratio
        p_within = p_of_margin(a, b, margin)[0] if has_margin else 1.0
        low, high = tested.interval(alpha)
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
            "mcse": montecarlo.of_shift(a, b, scale),
            "confidence": 1 - alpha,
            "effect": tested.effect,
            "p": tested.p(),
            "p_holm": p_holm,
            "family": len(contrasts),
            "margin": margin,
            "verdict": _verdict(tested, alpha, p_within),
        }


def _scale_of(comparisons: Sequence[Comparison], samples: Samples) -> Scale:
    return scale_of(*(samples(variant) for row in comparisons for side in row.sides for variant in side))


def _paired(row: Comparison, samples: Samples, scale: Scale) -> tuple[pd.Series, pd.Series]:
    """Return the paired samples of a comparison; for an interaction, samples of changes on the same scale."""
    sides = [(samples(a), samples(b)) for a, b in row.sides]
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


def disagreements(study: Study, runs: pd.DataFrame) -> list[str]:
    """List comparisons of waiting whose direction reverses when events that were never sensed are counted too.

    A swarm that never finds the difficult events would look fast by the events that it did find.
    """
    if not {WAITING, WAITING_ALL} <= set(runs):
        return []
    by_sensed, by_all = samples_of(runs, WAITING), samples_of(runs, WAITING_ALL)
    problems = []
    for settings in study.file.contrast:
        if settings.across or not {WAITING, WAITING_ALL} & set(study.metrics_of(settings)):
            continue
        for row in study.comparisons(settings):
            ((a, b),) = row.sides
            contrasts = [contrast(samples(a), samples(b)) for samples in (by_sensed, by_all)]
            signs = {
                0 if tested.estimate is None else int(np.sign(tested.estimate - tested.none)) for tested in contrasts
            }
            if signs == {-1, 1} and min(tested.p() for tested in contrasts) < ALPHA:
                level, reference = (study.level_title(settings.factor, name) for name in (row.level, row.reference))
                within = f" ({row.within_title})" if row.within else ""
                problems.append(
                    f"{level} against {reference}{within}: waiting by sensed events and by all events rank them in "
                    "opposite order"
                )
    return problems


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
