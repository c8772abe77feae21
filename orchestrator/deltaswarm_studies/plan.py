"""Preview what a study would run, how long that takes, and what it could show, before hours are spent on it."""

import itertools
import math
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np

from deltaswarm_orchestrator.processes.elsewhere import DENSE, PYTHON
from deltaswarm_orchestrator.run.choosing import planned_by
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.sweeps.plan import Variant
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.stats import pairs_needed, smallest_p
from deltaswarm_studies.study import Study
from deltaswarm_wire.extras import missing_by

MEASURED_VARIANTS = 24
MEASURED_S = 0.4
"""Wall time for which each of these variants is run to estimate its speed."""

DENSE_TIMES = 25.0
"""How many times less time the dense engine is expected to take: the least of docs/PERFORMANCE.md."""

MAX_REASONS = 3


def plan(study: Study, pilot: Path, workers: int) -> dict[str, Any]:
    """Describe the runs, their duration on this machine, and each family of tests.

    `pilot` is a folder whose `runs.csv`, if there is one, says how much replicates differ: a pilot's, or published.
    """
    effects, note = _effects(study, pilot / "runs.csv")
    engines = engines_of(study)
    planned_s = wall_s(study) / workers
    return {
        "study": study.name,
        "variants": len(study.sweep.variants),
        "repeats": study.repeats,
        "size": study.sweep.size,
        "each": "points" if study.ranges else "replicates",
        "workers": workers,
        "wall_s": planned_s,
        "engines": engines,
        "families": _families(study, effects),
        "note": note if study.file.contrast else None,
        "sensitivity": _sensitivity(study) if study.ranges else None,
    }


def too_few(study: Study) -> list[str]:
    """Say whether the replicates can show nothing in some families of tests, whatever the runs give."""
    published = [_claims(claim.source) for claim in study.file.claim if claim.published is not None]  # need no pairs
    tested = [_claims(claim.source) for claim in study.file.claim if claim.published is None]
    families = [row for row in _families(study, {}) if row["name"] not in {*published} - {*tested}]
    few = [row for row in families if row["repeats"] < row["repeats_needed"]]
    if not few:
        return []
    least, most = (choose(row["repeats"] for row in few) for choose in (min, max))
    given = f"{least} to {most}" if most > least else f"{least}"
    count = f"{len(few)} of {len(families)} families of tests can show nothing with {given} replicates"
    needed = max(row["repeats_needed"] for row in few)
    return [f"{study.name}: {count}; {needed} are needed (`deltaswarm study --plan` lists the families)"]


def text(planned: dict[str, Any]) -> str:
    wall = timedelta(seconds=round(planned["wall_s"]))
    return "\n".join(
        [
            planned["size"],
            f"  about {wall} on {planned['workers']} cores, by the speed of the first steps of each variant",
            _engines_line(planned["engines"]),
            *map(_line, planned["families"]),
            *([f"  {planned['note']}"] if planned["note"] else []),
            *([f"  {planned['sensitivity']}"] if planned["sensitivity"] else []),
        ]
    )


def engines_of(study: Study) -> dict[str, Any]:
    """Count the runs of each engine in one process, and why others than the dense engine do any."""
    runs, reasons = Counter({DENSE: 0, PYTHON: 0}), Counter[str]()
    for variant in study.sweep.variants:
        by, repeats = planned_by(variant.scenario), study.sweep.repeats[variant.label]
        runs[by.engine] += repeats
        if by.because:
            reasons[by.because] += repeats
    return {**runs, "because": [reason for reason, _ in reasons.most_common(MAX_REASONS)]}


def _engines_line(engines: dict[str, Any]) -> str:
    dense = f"{engines[DENSE]} runs by the dense engine (counted as 1/{DENSE_TIMES:g} of the Python engine's time)"
    line = f"  in one process: {dense}, {engines[PYTHON]} by the Python engine"
    return line + (f" ({'; '.join(engines['because'])})" if engines["because"] else "")


def _families(study: Study, effects: Mapping[tuple[int, str], str | None]) -> list[dict[str, Any]]:
    families = []
    for number, contrast in enumerate(study.file.contrast):
        if contrast.over:  # a mean over levels has no smallest p
            continue
        tested = [[*itertools.chain(*row.sides)] for row in study.comparisons(contrast)]
        for metric in study.metrics_of(contrast):
            family = _family(study, f"contrast {contrast.id!r}, {metric}", tested)
            families.append(family | {"shows": effects.get((number, metric))})
    for source in dict.fromkeys(claim.source for claim in study.file.claim):
        claims = [claim for claim in study.file.claim if claim.source == source]
        if all(claim.over for claim in claims):
            continue
        halves = 2 if any(claim.best_of and not claim.over for claim in claims) else 1
        families.append(_family(study, _claims(source), [claim.variants for claim in claims], halves))
    return families


def _claims(source: str) -> str:
    return f"claims of {source!r}" if source else "claims"


def _family(study: Study, name: str, tested: Sequence[Iterable[str]], halves: int = 1) -> dict[str, Any]:
    """Describe a family of tests, each of these variants, with the fewest replicates; of two halves one is compared."""
    tests = len(tested)
    repeats = min(map(study.repeats_of, tested)) // halves
    least = min(1.0, smallest_p(repeats) * tests)
    needed = halves * pairs_needed(tests)
    return {
        "name": name,
        "tests": tests,
        "repeats": halves * repeats,
        "smallest_p": least,
        "repeats_needed": needed,
        "shows": None,
    }


def _line(family: dict[str, Any]) -> str:
    line = f"  {family['name']}: {family['tests']} tests in a family, smallest corrected p {family['smallest_p']:.2g}"
    if family["repeats"] < family["repeats_needed"]:
        line += f": can show nothing, {family['repeats_needed']} replicates are needed"
    return line + (f"; shows {family['shows']} with a probability of 80 %" if family["shows"] else "")


def _sensitivity(study: Study) -> str:
    from deltaswarm_studies.sensitivity import features_in, share_interval, smallest_correlation  # needs pandas

    points = study.repeats
    low, high = share_interval(points // 2, points)
    tests = 2 * len(study.file.claim) * features_in(study.ranges)
    least = smallest_correlation(points, tests)
    return (
        f"shares of the space to within {50 * (high - low):.0f} percentage points; of {tests} rank correlations in a "
        f"family, shows those of {least:.2f} or more with a probability of 80 %"
    )


def _effects(study: Study, file: Path) -> tuple[dict[tuple[int, str], str | None], str | None]:
    """Return what each contrast and metric could show, by a pilot's runs, and a line about what is missing for it."""
    if not file.is_file():
        return {}, f"no {file}: with a pilot (--pilot FOLDER) also the smallest effects that could be shown are told"
    try:
        from deltaswarm_studies.contrasts import smallest_effects  # needs pandas and SciPy
        from deltaswarm_studies.origin import sealed_tables
    except ModuleNotFoundError as error:
        if not (needs := missing_by(error)):
            raise
        return {}, f"to tell the smallest effects that could be shown {needs}"
    sealed_tables(file.parent)
    return smallest_effects(study, file), None


def wall_s(study: Study) -> float:
    """Estimate the wall time of all runs, one after another in one process [s]."""
    variants = study.sweep.variants
    if points := study.sweep.points:  # at points that lie evenly among all, the variants in turn
        some = points[:: math.ceil(len(points) / MEASURED_VARIANTS)]
        measured: Sequence[Variant] = [at[i % len(at)] for i, at in enumerate(some)]
    else:
        measured = variants[:: math.ceil(len(variants) / MEASURED_VARIANTS)]
    weights = [study.sweep.repeats[variant.label] for variant in measured]
    a_run_s = np.average([_run_s(variant.scenario) for variant in measured], weights=weights)
    return float(a_run_s) * sum(study.sweep.repeats.values())


def _run_s(scenario: Scenario) -> float:
    swarm = InProcess(scenario)
    began = time.monotonic()
    for _ in swarm.steps():
        if time.monotonic() - began > MEASURED_S:
            break
    a_run_s = (time.monotonic() - began) / len(swarm.outcome.step_records) * scenario.run.steps
    return a_run_s / DENSE_TIMES if planned_by(scenario).engine == DENSE else a_run_s
