"""Preview what a study would run, how long that takes, and what it could show, before hours are spent on it."""

import math
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.stats import RATIO, pairs_needed, scale_of, smallest_effect, smallest_p
from deltaswarm_orchestrator.studies.metrics import ID
from deltaswarm_orchestrator.studies.settings import ContrastSettings
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_orchestrator.studies.tables import samples_of
from deltaswarm_orchestrator.sweeps.table import read_table
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.operator_messages import Clock

MEASURED_VARIANTS = 24
MEASURED_S = 0.4
"""Wall time for which each of these variants is run to estimate its speed."""

MIN_PILOT = 3
"""Fewest pairs of a pilot from which a spread is estimated."""


def plan(study: Study, pilot: Path, workers: int) -> str:
    """Describe the runs, their duration on this machine, and each family of tests, a line each.

    `pilot` is a folder whose `runs.csv`, if there is one, says how much replicates differ: a pilot's, or published.
    """
    file = pilot / "runs.csv"
    runs = read_table(file, ["variant"], needs=ID) if file.is_file() else pd.DataFrame(columns=ID)
    wall = timedelta(seconds=round(wall_s(study) / workers))
    lines = [study.sweep.size, f"  about {wall} on {workers} cores, by the speed of the first steps of each variant"]
    for contrast in study.file.contrast:
        for metric in study.metrics_of(contrast):
            family = len(list(study.comparisons(contrast)))
            line = _line(study, f"contrast {contrast.id!r}, {metric}", family)
            lines.append(line + _effect(study, contrast, metric, family, runs))
    sources = [claim.source for claim in study.file.claim]
    lines += [
        _line(study, f"claims of {source!r}" if source else "claims", sources.count(source))
        for source in dict.fromkeys(sources)
    ]
    if runs.empty and study.file.contrast:
        lines.append(
            f"  no {file}: with a pilot (--pilot FOLDER) the smallest effects that could be shown are told too"
        )
    return "\n".join(lines)


def _line(study: Study, name: str, family: int) -> str:
    least = min(1.0, smallest_p(study.repeats) * family)
    line = f"  {name}: {family} tests in a family, smallest corrected p {least:.2g}"
    if study.repeats < pairs_needed(family):
        line += f": can show nothing, {pairs_needed(family)} replicates are needed"
    return line


def _effect(study: Study, contrast: ContrastSettings, metric: str, family: int, runs: pd.DataFrame) -> str:
    """Say which effect the replicates would show with a probability of 80 %, for the median spread of the family."""
    if runs.empty or metric not in runs or study.repeats < pairs_needed(family):
        return ""
    of = samples_of(runs, metric)
    rows = list(study.comparisons(contrast))
    scale = scale_of(*(of(variant) for row in rows for side in row.sides for variant in side))
    spreads = []
    for row in rows:
        changes = [np.log(of(a)) - np.log(of(b)) if scale == RATIO else of(a) - of(b) for a, b in row.sides]
        differences = (changes[0] if len(changes) == 1 else changes[0] - changes[1]).dropna()
        spreads += [float(differences.std())] if len(differences) >= MIN_PILOT else []
    if not spreads:
        return ""
    shift = smallest_effect(float(np.median(spreads)), study.repeats, family)
    shown = f"{math.exp(shift):.2f} times" if scale == RATIO else f"{shift:.3g} {study.metrics[metric].unit}".rstrip()
    return f"; shows {shown} with a probability of 80 %"


def wall_s(study: Study) -> float:
    """Estimate the wall time of all runs, one after another in one process [s]."""
    variants = study.sweep.variants
    measured = variants[:: math.ceil(len(variants) / MEASURED_VARIANTS)]
    return float(np.mean([_run_s(variant.scenario) for variant in measured])) * len(variants) * study.repeats


def _run_s(scenario: Scenario) -> float:
    swarm = InProcess(scenario)
    began = time.monotonic()
    for step in _steps(scenario, began):
        record = swarm.step(step, False)
        swarm.close(Clock(step, record.time_s, False))
    return (time.monotonic() - began) / (step + 1) * scenario.run.steps


def _steps(scenario: Scenario, began: float) -> Iterator[int]:
    for step in range(scenario.run.steps - 1 or 1):
        yield step
        if time.monotonic() - began > MEASURED_S:
            return
