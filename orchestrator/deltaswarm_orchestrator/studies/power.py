"""Which effects a planned study could show, by how much the replicates of a pilot differ."""

import math
from pathlib import Path

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.significance import pairs_needed
from deltaswarm_orchestrator.stats import RATIO, scale_of, smallest_effect
from deltaswarm_orchestrator.studies.metrics import ID
from deltaswarm_orchestrator.studies.settings import ContrastSettings
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_orchestrator.studies.tables import samples_of
from deltaswarm_orchestrator.sweeps.table import read_table

MIN_PILOT = 3
"""Fewest pairs of a pilot from which a spread is estimated."""


def effects(study: Study, file: Path) -> dict[tuple[int, str], str | None]:
    """Describe the smallest effect of each contrast (by its place) and metric, from a pilot's `runs.csv`."""
    runs = read_table(file, ["variant"], needs=ID)
    return {
        (number, metric): _effect(study, contrast, metric, runs)
        for number, contrast in enumerate(study.file.contrast)
        for metric in study.metrics_of(contrast)
    }


def _effect(study: Study, contrast: ContrastSettings, metric: str, runs: pd.DataFrame) -> str | None:
    """Say which effect the replicates would show with a probability of 80 %, for the median spread of the family."""
    rows = list(study.comparisons(contrast))
    family = len(rows)
    if runs.empty or metric not in runs or study.repeats < pairs_needed(family):
        return None
    of = samples_of(runs, metric)
    scale = scale_of(*(of(variant) for row in rows for side in row.sides for variant in side))
    spreads = []
    for row in rows:
        changes = [np.log(of(a)) - np.log(of(b)) if scale == RATIO else of(a) - of(b) for a, b in row.sides]
        differences = (changes[0] if len(changes) == 1 else changes[0] - changes[1]).dropna()
        spreads += [float(differences.std())] if len(differences) >= MIN_PILOT else []
    if not spreads:
        return None
    shift = smallest_effect(float(np.median(spreads)), study.repeats, family)
    return f"{math.exp(shift):.2f} times" if scale == RATIO else f"{shift:.3g} {study.metrics[metric].unit}".rstrip()
