"""Generated caption text: sample sizes, missing values, values at the ceiling."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd

from deltaswarm_studies.ceilings import AT
from deltaswarm_studies.event_checks import horizons_s
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.kinds import KINDS
from deltaswarm_studies.metrics import source_of
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import planned_runs

Sizes = Mapping[str, int]
"""The number of replicates behind each value that a figure shows, by the value's name."""


def sizes_of(
    settings: FigureSettings, study: Study, rows: pd.DataFrame, keys: Sequence[str], metrics: Sequence[str]
) -> Sizes:
    """Count the replicates with values in each combination of these factors' levels, also where there is none."""
    known = rows.dropna(subset=list(metrics)) if metrics else rows
    variants = settings.variants or study.levels
    cells = dict.fromkeys(tuple((key, study.levels[name][key]) for key in keys if key) for name in variants)
    sizes = {}
    for cell in cells:
        own = known
        for key, level in cell:
            own = own[own[key] == level]
        name = ", ".join(study.level_title(key, level) for key, level in cell)
        sizes[name] = own["replicate"].nunique()
    return sizes


def n_of(sizes: Sizes) -> str:
    """Return the number of replicates, or their range, as `n = 18 to 20`."""
    some = [size for size in sizes.values() if size]
    return f"n = {min(some)}" + (f" to {max(some)}" if max(some) > min(some) else "")


def notes(
    settings: FigureSettings, study: Study, evidence: Evidence, rows: pd.DataFrame, sizes: Sizes, keys: Sequence[str]
) -> tuple[str, ...]:
    """Say what a figure lacks, and which of its values say only that they are no less; `keys` as for `sizes_of`."""
    told = []
    if empty := [name for name, size in sizes.items() if not size]:
        told.append(f"No values: {'; '.join(empty)}.")
    whole, drawn = planned_runs(study), rows.get("variant", settings.variants or [*study.levels])
    planned = sizes_of(replace(settings, variants=()), study, whole[whole["variant"].isin(drawn)], keys, ())
    if fewer := [f"{name} ({size} of {planned[name]})" for name, size in sizes.items() if 0 < size < planned[name]]:
        told.append(f"Fewer replicates than the study plans: {'; '.join(fewer)}.")
    if unjudged := [name for name in evidence.unjudged if name in (settings.variants or study.levels)]:
        told.append(f"Not judged, since too many runs are invalid: {'; '.join(map(study.variant_title, unjudged))}.")
    levels = heights(settings, study, evidence, rows)
    if undrawn := [name for name in settings.lines if name not in levels]:
        told.append(f"Lines of variants without values are missing: {'; '.join(undrawn)}.")
    metrics = dict.fromkeys(getattr(settings, key) for key in KINDS[settings.kind].metrics)
    told += [
        f"{study.metrics[name].title}: {reached} of {rows[name].count()} values are at the ceiling of "
        f"{ceiling_of(study, name):g} s: longer times count as that, so these values are lower bounds."
        for name in metrics
        if (reached := int(at_ceiling(study, name, rows).sum()))
    ]
    return tuple(told)


def heights(settings: FigureSettings, study: Study, evidence: Evidence, rows: pd.DataFrame) -> dict[str, float]:
    """Return the height of each line: a number, the median of a variant, or the metric's ceiling if values reach it.

    A variant without values has no line.
    """
    runs = evidence.means
    values = runs.groupby("variant")[settings.metric].median() if settings.metric in runs else pd.Series(dtype=float)
    lines = {name: values.get(value) if isinstance(value, str) else value for name, value in settings.lines.items()}
    if at_ceiling(study, settings.metric, rows).any():
        lines["ceiling"] = ceiling_of(study, settings.metric)
    return {name: float(value) for name, value in lines.items() if value is not None and not pd.isna(value)}


def averaged(settings: FigureSettings, study: Study) -> tuple[str, ...]:
    over = left_out(settings, study)
    return (f"Each value is the mean over {' and '.join(over)} within a replicate.",) if over else ()


def left_out(settings: FigureSettings, study: Study) -> list[str]:
    """List the titles of the factors over which a figure averages each replicate."""
    shown = {getattr(settings, key) for key in KINDS[settings.kind].factors}
    first: dict[tuple[str, ...], Mapping[str, str]] = {}
    found: set[str] = set()
    for variant in settings.variants or study.levels:
        levels = study.levels[variant]
        other = first.setdefault(tuple(level for name, level in levels.items() if name in shown), levels)
        found |= {name for name, level in levels.items() if level != other[name]}
    return [study.factor_title(name).partition(" [")[0] for name in study.factors if name in found]


def ceiling_of(study: Study, name: str) -> float:
    """Return the value that a metric cannot exceed because it counts longer times as the horizon; else infinity [s]."""
    source = source_of(study.metrics[name])
    return horizons_s(study, list(study.levels))[-1] if source and source.is_restricted else math.inf


def at_ceiling(study: Study, name: str, rows: pd.DataFrame) -> pd.Series:
    """Return which rows have a value that is, or almost is, the metric's ceiling."""
    return rows[name] >= AT * ceiling_of(study, name)
