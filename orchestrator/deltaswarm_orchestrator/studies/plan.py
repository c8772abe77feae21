"""Preview what a study would run, how long that takes, and what it could show, before hours are spent on it."""

import math
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import numpy as np

from deltaswarm_orchestrator.bench.doctor import INSTALL_STUDY, is_of_studies
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.significance import pairs_needed, smallest_p
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.operator_messages import Clock

MEASURED_VARIANTS = 24
MEASURED_S = 0.4
"""Wall time for which each of these variants is run to estimate its speed."""


def plan(study: Study, pilot: Path, workers: int) -> str:
    """Describe the runs, their duration on this machine, and each family of tests, a line each.

    `pilot` is a folder whose `runs.csv`, if there is one, says how much replicates differ: a pilot's, or published.
    """
    effects, note = _effects(study, pilot / "runs.csv")
    wall = timedelta(seconds=round(wall_s(study) / workers))
    lines = [study.sweep.size, f"  about {wall} on {workers} cores, by the speed of the first steps of each variant"]
    for number, contrast in enumerate(study.file.contrast):
        for metric in study.metrics_of(contrast):
            family = len(list(study.comparisons(contrast)))
            line = _line(study, f"contrast {contrast.id!r}, {metric}", family)
            lines.append(line + effects.get((number, metric), ""))
    sources = [claim.source for claim in study.file.claim]
    lines += [
        _line(study, f"claims of {source!r}" if source else "claims", sources.count(source))
        for source in dict.fromkeys(sources)
    ]
    return "\n".join([*lines, note] if note and study.file.contrast else lines)


def _effects(study: Study, file: Path) -> tuple[dict[tuple[int, str], str], str]:
    """Return what each contrast and metric could show, by a pilot's runs, and a line about what is missing for it."""
    if not file.is_file():
        return {}, f"  no {file}: with a pilot (--pilot FOLDER) the smallest effects that could be shown are told too"
    try:
        from deltaswarm_orchestrator.studies.power import effects
    except ModuleNotFoundError as error:
        if not is_of_studies(error):
            raise
        return {}, f"  the smallest effects that could be shown need {error.name}: {INSTALL_STUDY}"
    return effects(study, file), ""


def _line(study: Study, name: str, family: int) -> str:
    least = min(1.0, smallest_p(study.repeats) * family)
    line = f"  {name}: {family} tests in a family, smallest corrected p {least:.2g}"
    if study.repeats < pairs_needed(family):
        line += f": can show nothing, {pairs_needed(family)} replicates are needed"
    return line


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
