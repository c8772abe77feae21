"""The time until a moment over space: in rings of equal numbers of events around the densest place."""

import numpy as np
import pandas as pd

from deltaswarm_studies import events as event_tables
from deltaswarm_studies.event_checks import MOMENTS, horizon_s
from deltaswarm_studies.event_settings import RingsSettings
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.stats import describe
from deltaswarm_studies.study import Study
from deltaswarm_studies.tables import Row


def rings_of(study: Study, events: pd.DataFrame) -> pd.DataFrame:
    """Make a row per table `[[rings]]`, variant that has events, and ring; see `ring_rows`."""
    present = set(events["variant"]) if len(events) else set()
    return pd.DataFrame(
        [
            {"rings": settings.text, "metric": settings.metric, "variant": name, **row}
            for settings in study.file.rings
            for name in settings.variants or study.levels
            if name in present
            for row in ring_rows(study, settings, events, name)
        ]
    )


def ring_rows(study: Study, settings: RingsSettings | FigureSettings, events: pd.DataFrame, variant: str) -> list[Row]:
    """Describe each ring of a variant, the innermost first.

    Only events that could be followed for the horizon count, and a longer time counts as the horizon, as in the metric
    of the mean. A run's value is the mean over its events in the ring; the median over the runs has an exact 95 %
    interval.
    """
    followed_s = horizon_s(study, settings)
    rows = event_tables.of_variant(events, variant)
    if rows["from_densest_m"].isna().any():
        raise ValueError(f"events of {variant!r} are equally dense everywhere: no place is the densest")
    rows = event_tables.until(rows, MOMENTS[settings.metric], followed_s)
    rows = rows[rows["arrived_s"] + followed_s <= rows["end_s"]].sort_values("from_densest_m", kind="stable")
    return [
        {"ring": number, **_ring(rows.iloc[places])}
        for number, places in enumerate(np.array_split(np.arange(len(rows)), settings.rings), 1)
        if len(places)
    ]


def _ring(rows: pd.DataFrame) -> Row:
    by_run = describe(rows.groupby("replicate")["time_s"].mean())
    return {
        "from_m": rows["from_densest_m"].iloc[0],
        "until_m": rows["from_densest_m"].iloc[-1],
        "mean_m": rows["from_densest_m"].mean(),
        "events": len(rows),
        "beyond_horizon": rows["is_censored"].mean(),
        "runs": by_run.n,
        "time_s": by_run.median,
        "time_low_s": by_run.low,
        "time_high_s": by_run.high,
    }
