"""How close combinations of a study's factors come to published numbers, and medians by two factors."""

import math

import numpy as np
import numpy.typing as npt
import pandas as pd

from deltaswarm_orchestrator.stats import describe
from deltaswarm_orchestrator.studies.settings import CLOSEST, FARTHER, FitSettings, GridSettings
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_orchestrator.studies.tables import Row, column, samples_of

Floats = npt.NDArray[np.float64]

RESAMPLES = 4000
"""Bootstrap samples of the replicates, all variants alike, with seed 0."""


def fits_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per fit, combination of the other factors and target, the closest combination first.

    `distance` is from the median to the published one, in published interquartile ranges; `sum` adds the squares of a
    combination's distances. `closest` is the share of bootstrap samples of the replicates in which its sum is smallest;
    `verdict` says whether its sum is the smallest of all replicates.
    """
    rows: list[Row] = []
    for fit in study.file.fit:
        cells = study.cells([fit.factor])
        distances = np.stack([_distances(study, runs, fit, cell) for cell in cells])
        sums = (distances**2).sum(axis=1)
        winners = np.bincount(sums[:, 1:].argmin(axis=0), minlength=len(cells)) / RESAMPLES
        for rank, place in enumerate(sums[:, 0].argsort(kind="stable")):
            head = {"fit": fit.text, "within": ", ".join(cells[place].values())}
            found = {"sum": float(sums[place, 0]), "closest": float(winners[place])}
            tail = {**found, "verdict": FARTHER if rank else CLOSEST}
            rows += [
                {**head, "level": target.level, "metric": target.metric, "distance": float(distance), **tail}
                for target, distance in zip(fit.targets, distances[place, :, 0], strict=True)
            ]
    return pd.DataFrame(rows)


def _distances(study: Study, runs: pd.DataFrame, fit: FitSettings, cell: dict[str, str]) -> Floats:
    """Return the distance to each target (rows), of all replicates and of each bootstrap sample (columns)."""
    picks = np.random.default_rng(0).integers(study.repeats, size=(RESAMPLES, study.repeats))
    found = []
    for target in fit.targets:
        levels = {**cell, fit.factor: target.level}
        variant = next(name for name, own in study.levels.items() if own == levels)
        values = samples_of(runs, target.metric)(variant).reindex(range(study.repeats)).to_numpy(float)
        if np.isnan(values).all():
            found.append(np.full(RESAMPLES + 1, math.inf))
            continue
        medians = np.append(np.nanmedian(values), np.nanmedian(values[picks], axis=1))
        found.append((medians - target.says) / target.iqr)
    return np.stack(found)


def grids_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per grid, row and column: the lowest median of the column's levels, its interval, and the level."""
    rows: list[Row] = []
    for grid in study.file.grid:
        own = runs.assign(value=column(runs, grid.metric))
        for row in study.factors[grid.rows]:
            for heading, levels in grid.columns.items():
                cells = own[(own[grid.rows] == row) & own[grid.factor].isin(levels)].groupby(grid.factor)["value"]
                described = {str(level): describe(values) for level, values in cells}
                known = {level: found for level, found in described.items() if found.median is not None}
                if known:
                    best = min(known, key=lambda level: known[level].median or 0.0)
                    head = {"grid": grid.text, "metric": grid.metric, "row": row, "column": heading, "level": best}
                    found = known[best]
                    rows.append({**head, "n": found.n, "median": found.median, "low": found.low, "high": found.high})
    return pd.DataFrame(rows)


def grid_named(study: Study, text: str) -> GridSettings:
    """Return the settings of a grid."""
    return next(grid for grid in study.file.grid if grid.text == text)
