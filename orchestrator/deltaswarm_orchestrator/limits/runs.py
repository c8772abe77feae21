"""What is kept of each run of an experiment: one tidy row, and its time in windows where a fault comes and goes."""

import math

import orjson
import pandas as pd

from deltaswarm_orchestrator.figures.tables import require
from deltaswarm_orchestrator.limits.experiments import Experiment

WAITING, MESSAGES, IN_TREES = "waiting_s", "messages_per_s", "in_trees"
MEASURES = (WAITING, MESSAGES, IN_TREES)

BIN_S = 300.0
"""Windows of time [s] in figures and in the search for recovery: about 15 events arrive in one."""

_WHOLE = {
    WAITING: "waiting_time_s.mean_with_never_sensed",
    MESSAGES: "operator_messages_per_s.mean",
    IN_TREES: "agents_in_trees.mean",
}
_WINDOWS = {MESSAGES: "operator_messages", IN_TREES: "agents_in_trees"}
"""Columns of a sweep's table and of its series."""

_ID = ["experiment", "level", "mode", "replicate", "seed"]


def runs_of(experiment: Experiment, table: pd.DataFrame, windows: pd.DataFrame) -> pd.DataFrame:
    """A row per run: experiment, level, mode, replicate, seed, the measures, and how many agents a fault killed.

    Waiting time [s] counts events that were never sensed to the end of the run: left out, they would flatter a
    swarm that never finds them. Where the limit comes and goes, the measures are of that time only, NaN if a run
    is over before; of what stays, of the rest of the run.

    Args:
        experiment: whose runs these are.
        table: the sweep's, a row per run.
        windows: of `windows_of`.

    Raises:
        ValueError: the table lacks a column, or has a variant that is not the experiment's.
    """
    require(table, "variant", "replicate", "seed", *_WHOLE.values())
    rows = _identified(experiment, table)
    for measure, column in _WHOLE.items():
        rows[measure] = pd.to_numeric(table[column])
    rows["killed"] = [_killed(cell) for cell in table["faults"]] if "faults" in table else 0
    if experiment.fault is None:
        return rows
    until_s = math.inf if experiment.fault.until_s is None else experiment.fault.until_s
    within = windows[(windows["time_s"] >= experiment.fault.from_s) & (windows["time_s"] < until_s)]
    means = pd.DataFrame([_means(group) for _, group in within.groupby(_ID)], columns=[*_ID, *MEASURES])
    return rows.drop(columns=list(MEASURES)).merge(means, on=_ID, how="left")[[*_ID, *MEASURES, "killed"]]


def windows_of(experiment: Experiment, series: pd.DataFrame, step_s: float) -> pd.DataFrame:
    """A row per run and BIN_S seconds: `time_s` where it begins, `events` that arrived in it, and the measures.

    Messages are per second. A last window that is not full is left out.

    Raises:
        ValueError: the series lacks a column, or has a variant that is not the experiment's.
    """
    require(series, "variant", "replicate", "seed", "time_s", "events_arrived", "waiting_time_s", *_WINDOWS.values())
    rows = _identified(experiment, series)
    rows["time_s"] = (series["time_s"] // BIN_S) * BIN_S
    rows["events"] = series["events_arrived"]
    rows["waited_s"] = (series["waiting_time_s"] * series["events_arrived"]).fillna(0.0)
    rows[MESSAGES] = series[_WINDOWS[MESSAGES]] / step_s
    rows[IN_TREES] = series[_WINDOWS[IN_TREES]]
    by_bin = rows.groupby([*_ID, "time_s"], sort=False)
    found = by_bin.agg({"events": "sum", "waited_s": "sum", MESSAGES: "mean", IN_TREES: "mean"}).reset_index()
    size = by_bin.size().to_numpy()
    found[WAITING] = found["waited_s"] / found["events"].where(found["events"] > 0)
    whole: pd.DataFrame = found.loc[size == size.max(), [*_ID, "time_s", "events", *MEASURES]]
    return whole.reset_index(drop=True)


def _means(group: pd.DataFrame) -> dict[str, object]:
    """Of one run's windows: waiting by event, the rest by time."""
    head = {name: group[name].iloc[0] for name in _ID}
    events = float(group["events"].sum())
    waited_s = float((group[WAITING] * group["events"]).sum())
    return {
        **head,
        WAITING: waited_s / events if events else math.nan,
        MESSAGES: float(group[MESSAGES].mean()),
        IN_TREES: float(group[IN_TREES].mean()),
    }


def _identified(experiment: Experiment, table: pd.DataFrame) -> pd.DataFrame:
    """Which run each row is of."""
    parts = table["variant"].str.rpartition(", ")
    known = {level.label for level in experiment.levels}
    if strange := sorted(set(parts[0]) - known):
        raise ValueError(f"{experiment.name} has no level {strange[0]!r}; it has {', '.join(sorted(known))}")
    return pd.DataFrame(
        {
            "experiment": experiment.name,
            "level": parts[0],
            "mode": parts[2],
            "replicate": table["replicate"],
            "seed": table["seed"],
        }
    )


def _killed(cell: object) -> int:
    """How many agents the faults of a run killed: `faults` of its summary, as JSON."""
    found = orjson.loads(cell) if isinstance(cell, str) else []
    return sum(len(fault["agents"]) for fault in found if fault["kind"] == "kill")
