"""Time until a swarm has recovered from a fault: until it is again like the same swarm without the fault."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from deltaswarm_studies.metrics import PER_EVENT
from deltaswarm_studies.settings import RecoverySettings
from deltaswarm_studies.study import Study

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
    rows = windows[windows["time_s"] >= settings.after_s - 1e-9 * window_s]
    for factor, level in cell.items():
        rows = rows[rows[factor] == level]
    # Means over events are weighted by events, other metrics by 1.
    values, weights = rows[settings.metric], rows["events"] if settings.metric in PER_EVENT else 1.0
    rows = rows.assign(total=(values * weights).fillna(0.0), weight=values.notna() * weights)
    tables = [
        rows[rows[settings.factor] == level]
        .pivot_table(index="replicate", columns="time_s", values=name, dropna=False)
        .fillna(0.0)
        for level in (settings.level, settings.reference)
        for name in ("total", "weight")
    ]
    replicates = tables[0].index.intersection(tables[2].index)
    times_s = tables[0].columns.intersection(tables[2].columns)
    sums = np.stack([table.loc[replicates, times_s].to_numpy(float) for table in tables])
    count = len(replicates)
    if not count or len(times_s) < settings.windows:
        return {"n": count, "back_s": math.nan, "low_s": math.nan, "high_s": math.nan}
    ends_s = times_s.to_numpy(float) + window_s
    low_s, high_s = math.nan, math.nan
    if count > 1:
        generator = np.random.default_rng(0)
        drawn = (generator.integers(count, size=count) for _ in range(RESAMPLES))
        resampled_s = np.sort([_back_s(settings, sums[:, chosen], ends_s) for chosen in drawn])
        # By rank, not by interpolation: there is no value between 300 s and never.
        ranks = math.floor(TAIL * (RESAMPLES - 1)), math.ceil((1 - TAIL) * (RESAMPLES - 1))
        low_s, high_s = (float(resampled_s[rank]) for rank in ranks)
    return {"n": count, "back_s": _back_s(settings, sums, ends_s), "low_s": low_s, "high_s": high_s}


def _back_s(settings: RecoverySettings, sums: Floats, ends_s: Floats) -> float:
    """Compute when the swarm is back, counted from `after_s` [s].

    Args:
        settings: what counts as being back.
        sums: (4, replicates, windows) sums and weights with the fault, then without it.
        ends_s: (windows,) the end of each window [s].
    """
    totals = sums.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        fault, reference = totals[::2] / totals[1::2]
        ratios = np.where((fault == 0) & (reference == 0), 1.0, fault / reference)
    least = 0.0 if settings.metric in FEWER_IS_BETTER else 1 / settings.tolerance
    is_well = (ratios <= settings.tolerance) & (ratios >= least)
    is_back = np.lib.stride_tricks.sliding_window_view(is_well, settings.windows).all(axis=1)
    return float(ends_s[is_back.argmax()]) - settings.after_s if is_back.any() else math.inf
