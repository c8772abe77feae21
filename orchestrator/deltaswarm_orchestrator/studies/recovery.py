"""Time until a swarm has recovered from a fault: until it is again like the same swarm without the fault."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from deltaswarm_orchestrator.studies.metrics import PER_EVENT
from deltaswarm_orchestrator.studies.settings import RecoverySettings
from deltaswarm_orchestrator.studies.study import Study

RESAMPLES = 999
TAIL = 0.025

FEWER_IS_BETTER = (*PER_EVENT, "open_events")

Floats = npt.NDArray[np.float64]


def recovery_of(study: Study, windows: pd.DataFrame) -> pd.DataFrame:
    """Make a row per cell: n replicates, and the time `back_s` from `after_s` on, with its interval [s].

    In each window, the mean over the replicates is compared with the mean of the same replicates without the fault,
    which saw the same arrivals. The swarm is back at the end of the first of `windows` consecutive windows that lie
    within the tolerance: times and open events are not more, other metrics are neither more nor less. `back_s` is inf
    if the swarm is not back before the end, NaN if nothing is known. The interval is a percentile bootstrap over
    replicates.
    """
    rows = [
        {
            "metric": settings.metric,
            "level": settings.level,
            "reference": settings.reference,
            "within": ", ".join(cell.values()),
            **_cell(settings, cell, windows, study.file.study.window_s),
        }
        for settings in study.file.recovery
        for cell in study.cells([settings.factor])
    ]
    return pd.DataFrame(rows)


def _cell(settings: RecoverySettings, cell: dict[str, str], windows: pd.DataFrame, window_s: float) -> dict[str, Any]:
    after = windows[windows["time_s"] >= settings.after_s - 1e-9 * window_s]
    for factor, level in cell.items():
        after = after[after[factor] == level]
    own, reference = (after[after[settings.factor] == one] for one in (settings.level, settings.reference))
    totals, weights = _by_replicate(own, settings.metric)
    base_totals, base_weights = _by_replicate(reference, settings.metric)
    shared = totals.index.intersection(base_totals.index)
    columns = totals.columns.intersection(base_totals.columns)
    frames = tuple(frame.loc[shared, columns].to_numpy(float) for frame in (totals, weights, base_totals, base_weights))
    count = len(shared)
    if not count or len(columns) < settings.windows:
        return {"n": count, "back_s": math.nan, "low_s": math.nan, "high_s": math.nan}
    low_s, high_s = math.nan, math.nan
    ends_s = columns.to_numpy(float) + window_s
    if count > 1:
        generator = np.random.default_rng(0)
        drawn = (generator.integers(count, size=count) for _ in range(RESAMPLES))
        found = np.sort([_back_s(settings, tuple(frame[chosen] for frame in frames), ends_s) for chosen in drawn])
        # By rank, not by interpolation: there is no value between 300 s and never.
        ends = math.floor(TAIL * (RESAMPLES - 1)), math.ceil((1 - TAIL) * (RESAMPLES - 1))
        low_s, high_s = (float(found[end]) for end in ends)
    return {"n": count, "back_s": _back_s(settings, frames, ends_s), "low_s": low_s, "high_s": high_s}


def _by_replicate(rows: pd.DataFrame, metric: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return sums and weights (replicates, windows): means over events are weighted by events, other metrics by 1."""
    weights = rows["events"] if metric in PER_EVENT else pd.Series(1.0, index=rows.index)
    known = rows.assign(weight=weights.where(rows[metric].notna(), 0.0), total=(rows[metric] * weights).fillna(0.0))
    total, weight = (
        known.pivot_table(index="replicate", columns="time_s", values=column, dropna=False).fillna(0.0)
        for column in ("total", "weight")
    )
    return total, weight


def _back_s(settings: RecoverySettings, frames: tuple[Floats, ...], ends_s: Floats) -> float:
    """Compute when the swarm is back, counted from `after_s` [s].

    Args:
        settings: what counts as being back.
        frames: sums and weights (replicates, windows) with the fault, then without it.
        ends_s: (windows,) the end of each window [s].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        own, base = (frames[i].sum(axis=0) / frames[i + 1].sum(axis=0) for i in (0, 2))
        ratios = np.where((own == 0) & (base == 0), 1.0, own / base)
    least = 0.0 if settings.metric in FEWER_IS_BETTER else 1 / settings.tolerance
    well = (ratios <= settings.tolerance) & (ratios >= least)
    for first in range(len(well) - settings.windows + 1):
        if well[first : first + settings.windows].all():
            return float(ends_s[first]) - settings.after_s
    return math.inf
