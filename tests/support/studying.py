"""A small study with made-up tables for tests, so that it is known what must come out."""

import tomllib
from collections.abc import Callable
from functools import cache
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.sweeps.load import STUDY_TABLES, make_sweep
from deltaswarm_orchestrator.sweeps.plan import Sweep
from deltaswarm_studies.load import load_study, make_study
from deltaswarm_studies.settings import StudyFile
from deltaswarm_studies.study import Study
from deltaswarm_wire import checked

SWEEP = """
schema = 1
name = "made-up"
base = "smoke"

[scenario]
run.duration_s = 1000.0
metrics.horizon_s = 100.0

[sweep]
repeats = 10
series_every_s = 100.0

[sweep.axes]
radio.loss = [0.0, 0.5, 0.9]

[[sweep.paired]]
label = ["decentralised", "hybrid 3"]
control.mode = ["decentralised", "hybrid"]
"""
OWN = """
[study]
factors = { loss = "frames lost [share]", mode = "control" }
metrics = ["waiting_all", "messages"]
window_s = 100.0
"""

FIGURES = (
    '[[figure]]\nname = "boxes"\nx = "mode"\nhue = "loss"\ncaption = "Boxes."\n'
    '[[figure]]\nname = "levels"\nkind = "levels"\nx = "loss"\nhue = "mode"\ncaption = "Levels."\n'
    '[[figure]]\nname = "time"\nkind = "time"\nmetric = "waiting_all"\nhue = "mode"\nfacet = "loss"\n'
    'spans = [{ text = "fault", from_s = 100.0, until_s = 300.0 }]\ncaption = "Time."\n'
    '[[figure]]\nname = "plane"\nkind = "plane"\nx = "waiting"\nmetric = "messages"\nhue = "mode"\n'
    'path = ["loss=0.0, hybrid 3", "loss=0.5, hybrid 3"]\ncaption = "Plane."\n'
    '[[figure]]\nname = "frontier"\nkind = "frontier"\nx = "waiting"\nmetric = "messages"\ncaption = "Frontier."\n'
    'paths = { loss = ["loss=0.0, hybrid 3", "loss=0.9, hybrid 3"] }\n'
)
"""A figure of each kind that runs alone can fill."""

Value = Callable[[str, str, int], float]
"""Of a level of loss, a mode and a replicate."""

LEVELS, MODES = ("loss=0.0", "loss=0.5", "loss=0.9"), ("decentralised", "hybrid 3")


built_in = cache(load_study)
"""A built-in study by its name: to load one takes up to seconds, so each is loaded once."""


@cache
def _swept(text: str) -> Sweep:
    return make_sweep(tomllib.loads(text))


@cache
def made(own: str = OWN, sweep: str = SWEEP) -> Study:
    """The study of two TOML texts, checked once for each."""
    table = tomllib.loads(own)
    assert set(table) <= set(STUDY_TABLES)
    return make_study("made-up", checked.load(StudyFile, table), _swept(sweep))


def spread(level: str, mode: str, replicate: int) -> float:
    """Replicates that differ as arrivals do; neither loss nor mode changes anything."""
    return 20.0 * 1.05**replicate


def table(waiting: Value = spread, messages: Value = spread, sensed: Value | None = None) -> pd.DataFrame:
    """A sweep's table."""
    rows: list[dict[str, Any]] = [
        {
            "variant": f"{level}, {mode}",
            "replicate": replicate,
            "seed": 100 + replicate,
            "waiting_time_s.mean": (sensed or waiting)(level, mode, replicate),
            "waiting_time_s.restricted_mean": waiting(level, mode, replicate),
            "operator_messages_per_s.mean": messages(level, mode, replicate),
            "agents_in_trees.mean": 12.0,
        }
        for level in LEVELS
        for mode in MODES
        for replicate in range(10)
    ]
    return pd.DataFrame(rows)


def series(waiting: Callable[[str, str, int, float], float], end_s: float = 1000.0) -> pd.DataFrame:
    """A sweep's series, with five followed events in each window of 100 s."""
    rows = [
        {
            "variant": f"{level}, {mode}",
            "replicate": replicate,
            "seed": 100 + replicate,
            "time_s": time_s,
            "events_followed": 5.0,
            "waiting_time_s": waiting(level, mode, replicate, time_s),
            "operator_messages": 4.0,
            "agents_in_trees": min(12.0, time_s / 50),
        }
        for level in LEVELS
        for mode in MODES
        for replicate in range(10)
        for time_s in [100.0 * window for window in range(int(end_s // 100))]
    ]
    return pd.DataFrame(rows)


LIMIT = '[[contrast]]\nid = "limit"\nfactor = "loss"\nreference = "loss=0.0"\nmargin = 1.1\n'


def worse_at_90(level: str, mode: str, replicate: int) -> float:
    """Under loss 0.9 hybrid swarms wait twice as long, decentralised ones as long as ever."""
    return spread(level, mode, replicate) * (2 if (level, mode) == ("loss=0.9", "hybrid 3") else 1)


FAST, SLOW, SAME = "loss=0.9, decentralised", "loss=0.9, hybrid 3", "loss=0.0, hybrid 3"
"""Variants that `worse_at_90` tells apart."""
