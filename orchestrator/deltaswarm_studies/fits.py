"""How close combinations of a study's factors come to published numbers, and medians by two factors."""

import math

import numpy as np
import numpy.typing as npt
import pandas as pd

from deltaswarm_studies.settings import FitSettings, FitVerdict
from deltaswarm_studies.stats import describe
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import Row, column, samples_of

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
            verdict: FitVerdict = "farther" if rank else "closest"
            tail = {"sum": float(sums[place, 0]), "closest": float(winners[place]), "verdict": verdict}
            rows += [
                {**head, "level": target.level, "metric": target.metric, "distance": float(distance), **tail}
                for target, distance in zip(fit.targets, distances[place, :, 0], strict=True)
            ]
    return pd.DataFrame(rows)


def _distances(study: Study, runs: pd.DataFrame, fit: FitSettings, cell: dict[str, str]) -> Floats:
    """Return the distance to each target (rows), of all replicates and of each bootstrap sample (columns)."""
    picks = np.random.default_rng(0).integers(study.repeats, size=(RESAMPLES, study.repeats))
    distances = []
    for target in fit.targets:
        levels = {**cell, fit.factor: target.level}
        variant = next(name for name, own_levels in study.levels.items() if own_levels == levels)
        values = samples_of(runs, target.metric)(variant).reindex(range(study.repeats)).to_numpy(float)
        if np.isnan(values).all():
            distances.append(np.full(RESAMPLES + 1, math.inf))
            continue
        medians = np.append(np.nanmedian(values), np.nanmedian(values[picks], axis=1))
        distances.append((medians - target.says) / target.iqr)
    return np.stack(distances)


def grids_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per grid, row and column: the lowest median of the column's levels, its interval, and the level."""
    rows: list[Row] = []
    for grid in study.file.grid:
        values = runs.assign(value=column(runs, grid.metric))
        for row in study.factors[grid.rows]:
            for heading, levels in grid.columns.items():
                cells = values[(values[grid.rows] == row) & values[grid.factor].isin(levels)].groupby(grid.factor)[
                    "value"
                ]
                medians = {str(level): describe(cell) for level, cell in cells}
                known = {level: cell.median for level, cell in medians.items() if cell.median is not None}
                if known:
                    best = min(known, key=known.__getitem__)
                    head = {"grid": grid.text, "metric": grid.metric, "row": row, "column": heading, "level": best}
                    rows.append(head | {name: getattr(medians[best], name) for name in ("n", "median", "low", "high")})
    return pd.DataFrame(rows)
