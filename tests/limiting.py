"""Tables of limited networks for tests: made up, so that it is known what must be found in them."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.limits.experiments import EXPERIMENTS, MODES, Experiment
from deltaswarm_orchestrator.limits.findings import Done, Findings, findings_of

DURATION_S, EVERY_S = 9000.0, 100.0

MANIFEST = {
    "finished": 1,
    "repeats": 10,
    "proofs": {"checked": 0, "equal": 0},
    "digest": "d0",
    "started": "2026-01-01T00:00:00Z",
    "wall_s": 60.0,
    "versions": {"deltaswarm": "0"},
    "code": ["c0"],
}

Value = Callable[[str, str, int], float]
"""Of a level's label, a mode and a replicate."""

InTime = Callable[[str, str, int, float], float]
"""Of the time [s] besides."""


def plain(level: str, mode: str, replicate: int) -> float:
    """No limit does anything; replicates differ, as arrivals do, and so does what sets the modes apart."""
    return 20.0 + MODES.index(mode) * (2 + replicate / 7) + replicate / 10


def table(experiment: Experiment, waiting: Value = plain, messages: Value = plain, repeats: int = 10) -> pd.DataFrame:
    """A sweep's table."""
    rows = [
        {
            "variant": f"{level.label}, {mode}",
            "replicate": replicate,
            "seed": 100 + replicate,
            "waiting_time_s.mean_with_never_sensed": waiting(level.label, mode, replicate),
            "operator_messages_per_s.mean": messages(level.label, mode, replicate),
            "agents_in_trees.mean": 0.0 if mode == "decentralised" else 12.0,
            "faults": '[{"kind":"kill","agents":[1,2]}]' if level.label.endswith("lost") else "[]",
            "steps": DURATION_S,
        }
        for level in experiment.levels
        for mode in MODES
        for replicate in range(repeats)
    ]
    return pd.DataFrame(rows)


def series(
    experiment: Experiment, waiting: InTime | None = None, messages: InTime | None = None, repeats: int = 10
) -> pd.DataFrame:
    """A sweep's series: five events in each window."""

    def steady(level: str, mode: str, replicate: int, time_s: float) -> float:
        return plain(level, mode, replicate)

    wait, send = waiting or steady, messages or steady
    rows = [
        {
            "variant": f"{level.label}, {mode}",
            "replicate": replicate,
            "seed": 100 + replicate,
            "time_s": time_s,
            "events_arrived": 5.0,
            "waiting_time_s": wait(level.label, mode, replicate, time_s),
            "operator_messages": send(level.label, mode, replicate, time_s),
            "agents_in_trees": 0.0 if mode == "decentralised" else 12.0,
        }
        for level in experiment.levels
        for mode in MODES
        for replicate in range(repeats)
        for time_s in np.arange(0.0, DURATION_S, EVERY_S)
    ]
    return pd.DataFrame(rows)


def done(
    name: str, table_of: pd.DataFrame | None = None, series_of: pd.DataFrame | None = None, repeats: int = 10
) -> Done:
    """A finished experiment; `repeats` is of the tables that are not given."""
    experiment = EXPERIMENTS[name]
    return Done(
        experiment,
        MANIFEST,
        table(experiment, repeats=repeats) if table_of is None else table_of,
        series(experiment, repeats=repeats) if series_of is None else series_of,
        1.0,
    )


def found(*all_done: Done) -> Findings:
    """What follows from them."""
    return findings_of(all_done)
