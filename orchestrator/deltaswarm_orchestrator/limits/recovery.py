"""How long a swarm needs to come back after a fault: when it is again as the same swarm to which nothing happened."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from deltaswarm_orchestrator.limits.experiments import MODES, Experiment, Level
from deltaswarm_orchestrator.limits.runs import BIN_S, MEASURES, WAITING

TOLERANCE = 1.25
"""A swarm is back when it is at most so many times off the one to which nothing happened."""
IN_A_ROW = 2
"""In so many windows one after the other: one alone may be chance."""
RESAMPLES = 999
CONFIDENCE = 0.95

COLUMNS = ("experiment", "level", "reference", "mode", "measure", "n", "back_s", "low_s", "high_s", "worst")

Floats = npt.NDArray[np.float64]


def recovery_of(experiment: Experiment, windows: pd.DataFrame) -> pd.DataFrame:
    """How long after a fault each mode needs to come back; for what ends, after its end.

    A mode's mean over the replicates, window by window, is held against that of the same replicates without the
    fault, which saw the same arrivals. It is back at the end of the first window in which, and in the one after
    which, the two are within TOLERANCE of each other: waiting not longer, messages and agents in trees neither
    more nor fewer. The interval is by bootstrap over the replicates. For every level that stands beside there is a
    second answer, against that level, since a swarm that has lost agents for good may never be what it was.

    Returns:
        One row per level, reference, mode and measure: n replicates, `back_s` with `low_s` and `high_s` [s], inf
        for not by the end of the run, NaN for not known; `worst` is the ratio farthest from 1 in the windows.
    """
    rows = [
        _row(experiment, windows, level, reference, mode, measure)
        for level, reference in _compared(experiment)
        for mode in MODES
        for measure in MEASURES
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _compared(experiment: Experiment) -> Iterator[tuple[Level, Level]]:
    if experiment.fault is not None:
        beside = [level for level in experiment.levels if level.is_beside]
        yield from ((level, reference) for level in experiment.harder for reference in (experiment.base, *beside))


def _row(
    experiment: Experiment, windows: pd.DataFrame, level: Level, reference: Level, mode: str, measure: str
) -> dict[str, Any]:
    assert experiment.fault is not None
    after = windows[(windows["mode"] == mode) & (windows["time_s"] >= experiment.fault.over_s)]
    (with_fault, weights), (without, reference_weights) = (
        _by_replicate(after[after["level"] == one.label], measure) for one in (level, reference)
    )
    shared = with_fault.index.intersection(without.index)
    pairs = tuple(
        frame.reindex(shared).to_numpy(dtype=np.float64) for frame in (with_fault, weights, without, reference_weights)
    )
    head = dict(
        zip(COLUMNS[:6], (experiment.name, level.label, reference.label, mode, measure, len(shared)), strict=True)
    )
    width = min((frame.shape[1] for frame in pairs), default=0)
    if not len(shared) or width < IN_A_ROW:
        return head | dict.fromkeys(COLUMNS[6:], math.nan)
    whole = tuple(frame[:, :width] for frame in pairs)
    ratios = _ratios(*whole)
    low_s, high_s = _interval(whole, measure)
    known = ratios[np.isfinite(ratios) & (ratios > 0)]
    worst = float(known[np.argmax(np.abs(np.log(known)))]) if len(known) else math.nan
    return head | {"back_s": back_s(ratios, measure), "low_s": low_s, "high_s": high_s, "worst": worst}


def _by_replicate(rows: pd.DataFrame, measure: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Sums and weights, a row per replicate and a column per window: of waiting by event, of the rest by window."""
    weights = rows["events"] if measure == WAITING else pd.Series(1.0, index=rows.index)
    known = rows.assign(weight=weights.where(rows[measure].notna(), 0.0), total=(rows[measure] * weights).fillna(0.0))
    total, weight = (
        known.pivot_table(index="replicate", columns="time_s", values=column, dropna=False).fillna(0.0)
        for column in ("total", "weight")
    )
    return total, weight


def _ratios(total: Floats, weight: Floats, reference_total: Floats, reference_weight: Floats) -> Floats:
    """The mean with the fault over the mean without (w,), from sums and weights (replicates, w).

    Where both are 0, as agents in trees of a swarm that has none, it is 1; NaN where it is not known.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        own = total.sum(axis=0) / weight.sum(axis=0)
        without = reference_total.sum(axis=0) / reference_weight.sum(axis=0)
        return np.where((own == 0) & (without == 0), 1.0, own / without)


def back_s(ratios: Floats, measure: str) -> float:
    """When a swarm is back [s], by its ratios in windows (w,) to the one without a fault; inf if it is not."""
    least = 0.0 if measure == WAITING else 1 / TOLERANCE
    well = (ratios <= TOLERANCE) & (ratios >= least)
    for first in range(len(well) - IN_A_ROW + 1):
        if well[first : first + IN_A_ROW].all():
            return (first + 1) * BIN_S
    return math.inf


def _interval(pairs: tuple[Floats, ...], measure: str) -> tuple[float, float]:
    """The percentile bootstrap interval of `back_s` over replicates; NaN for fewer than two."""
    count = len(pairs[0])
    if count < 2:
        return math.nan, math.nan
    generator = np.random.default_rng(0)
    drawn = [generator.integers(count, size=count) for _ in range(RESAMPLES)]
    found = np.sort([back_s(_ratios(*(frame[chosen] for frame in pairs)), measure) for chosen in drawn])
    tail = (1 - CONFIDENCE) / 2
    # By rank, not by interpolation: there is nothing between 300 s and never.
    return float(found[math.floor(tail * (RESAMPLES - 1))]), float(found[math.ceil((1 - tail) * (RESAMPLES - 1))])
