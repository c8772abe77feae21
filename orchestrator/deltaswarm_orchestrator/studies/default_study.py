"""Study a sweep that has no study file: compare every factor's levels, and draw the main metrics."""

from collections.abc import Sequence

import pandas as pd

from deltaswarm_orchestrator.studies.load import make_study
from deltaswarm_orchestrator.studies.metrics import BUILT_IN, COMPLETION, WAITING, WAITING_ALL, MetricSettings
from deltaswarm_orchestrator.studies.settings import ContrastSettings, FigureSettings, StudyFile, StudySettings
from deltaswarm_orchestrator.studies.study import Study, default_factors, numbers_in
from deltaswarm_orchestrator.sweeps.plan import Sweep

MAIN = (WAITING, WAITING_ALL, COMPLETION, "messages", "frames_sent", "agents_in_trees")
DRAWN = (WAITING, COMPLETION, "messages")
OVER_TIME = "agents_in_trees"


def bare_study(
    sweep: Sweep, table: pd.DataFrame, *, has_series: bool, reference: str | None = None, more: Sequence[str] = ()
) -> Study:
    """Make a study that compares every factor's levels with the first, or with `reference`.

    `more` are columns of the table to study besides the main metrics.

    Raises:
        ValueError: If no factor has the reference among its levels, or the table lacks a column.
    """
    factors = dict(zip(default_factors(sweep), sweep.factors, strict=True))
    references = {
        name: reference if reference is not None and reference in levels else levels[0]
        for name, levels in factors.items()
    }
    if reference is not None and reference not in references.values():
        known = ", ".join(repr(level) for levels in factors.values() for level in levels)
        raise ValueError(f"--reference must be a level of what was swept (got {reference!r}; there are {known})")
    for column in more:
        if column not in table:
            raise ValueError(f"--metric must be a column of table.csv (got {column!r})")
    there = [name for name in MAIN if BUILT_IN[name].column in table and table[BUILT_IN[name].column].notna().any()]
    file = StudyFile(
        StudySettings(
            title=f"Sweep {sweep.name}",
            question="How do the levels of what was swept differ?",
            factors={name: name for name in factors},
            metrics=(*there, *more),
            window_s=sweep.file.sweep.series_every_s or 300.0,
        ),
        tuple(MetricSettings(name=column, column=column) for column in more),
        tuple(
            ContrastSettings(
                id=name,
                text=f"The levels of {name} against {references[name]}",
                factor=name,
                reference=references[name],
                metrics=(*there[:1], *there[2:], *more),
            )
            for name, levels in factors.items()
            if len(levels) > 1
        ),
        figure=tuple(_figures(factors, [name for name in DRAWN if name in there], has_series)),
    )
    return make_study(sweep.name, file, sweep)


def _figures(factors: dict[str, Sequence[str]], metrics: Sequence[str], has_series: bool) -> list[FigureSettings]:
    """Choose boxes, or medians along a numeric factor; the next factor is shown by colour, a third by panel."""
    names = sorted(factors, key=lambda name: -len(factors[name]))
    numeric = [name for name in names if len(factors[name]) > 2 and numbers_in(factors[name])]
    x = numeric[0] if numeric else names[0]
    hue, facet, *_ = [*(name for name in names if name != x), "", ""]
    kind = "levels" if numeric else "boxes"
    drawn = [
        FigureSettings(name=metric, kind=kind, metric=metric, x=x, hue=hue, facet=facet, caption=_CAPTIONS[kind])
        for metric in metrics
    ]
    if has_series:
        over_time = "Agents in trees over time: means over the replicates with 95 % intervals."
        drawn.append(FigureSettings(name=OVER_TIME, kind="time", metric=OVER_TIME, hue=x, facet=hue, caption=over_time))
    return drawn


_CAPTIONS = {
    "boxes": "A point per replicate; boxes span the quartiles with the median as a line.",
    "levels": "Medians over the replicates with exact 95 % intervals.",
}
