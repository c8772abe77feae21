"""The table of a study's events: one row per event, which events are kept, and which are missing."""

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.results.outcome import COMPLETED, SENSED, TOLD, WORKED, Moment
from deltaswarm_orchestrator.run.in_process import densest_places
from deltaswarm_orchestrator.sweeps import table as tables
from deltaswarm_orchestrator.sweeps.table import Finished, ranges
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.event_checks import asked, asked_variants
from deltaswarm_studies.study import Study

MOMENTS = [moment.column for moment in (SENSED, TOLD, WORKED, COMPLETED)]
RUN = ["variant", "replicate"]
COLUMNS = [*RUN, "event", "x_m", "y_m", "from_densest_m", "arrived_s", *MOMENTS, "end_s"]
"""Columns of `events.csv`. A moment without a value did not come before the end of the run, `end_s`."""

DIGITS = 3
"""Decimals of lengths [m]."""

NO_EVENTS = "this study's runs carry no events"
"""Why nothing can be said about single events: the runs are of a version that did not keep them."""


def events_of(study: Study, runs: Finished) -> pd.DataFrame:
    """Make a row per event, of the variants that the study asks about; of all if it asks about none.

    The replicates are kept whole, from the first on, up to `study.max_events` rows. Otherwise variants would no longer
    be comparable.
    """
    wanted = asked_variants(study)
    found = [(job, result) for job, result in runs if job.variant.label in wanted and result.get("events")]
    sizes: dict[int, int] = {}
    for job, result in found:
        sizes[job.replicate] = sizes.get(job.replicate, 0) + len(result["events"]["event"])
    totals = dict(zip(sorted(sizes), np.cumsum([sizes[number] for number in sorted(sizes)]).tolist(), strict=True))
    kept = [(job, result) for job, result in found if totals[job.replicate] <= study.file.study.max_events]
    events = tables.events_of(kept)
    if events.empty:
        return pd.DataFrame(columns=COLUMNS)
    scenarios = {(job.variant.label, job.replicate): job.scenario for job, _ in kept}
    alike = {run: (scenario.events.density, scenario.arena) for run, scenario in scenarios.items()}
    places = {density: scenarios[run] for run, density in alike.items()}
    order = list(places)
    runs_of = pd.Series([order.index(alike[run]) for run in zip(events["variant"], events["replicate"], strict=True)])
    events["from_densest_m"] = pd.concat(
        [from_densest_m(places[order[index]], events[runs_of == index]) for index in range(len(order))]
    )
    return events[COLUMNS].round({"x_m": DIGITS, "y_m": DIGITS, "from_densest_m": DIGITS})


def from_densest_m(scenario: Scenario, events: pd.DataFrame) -> pd.Series:
    """Return each event's distance from the place that was densest when it arrived [m]; NaN if there is none."""
    densest_m = densest_places(scenario)
    arrived_s = np.sort(events["arrived_s"].unique())  # in order: the place is found once for each stretch of time
    places_m = {time_s: densest_m(time_s) or (np.nan, np.nan) for time_s in arrived_s.tolist()}
    centres_m = np.array([places_m[time_s] for time_s in events["arrived_s"]])
    offsets_m = events[["x_m", "y_m"]].to_numpy(float) - centres_m
    return pd.Series(np.hypot(*offsets_m.T), index=events.index)


def until(events: pd.DataFrame, moment: Moment, horizon_s: float) -> pd.DataFrame:
    """Return, beside each event, the time until a moment and whether it is censored: `time_s`, `is_censored`.

    An event is followed until its moment, the horizon or the end of its run, whichever comes first.
    """
    follow_s = np.minimum(events["end_s"] - events["arrived_s"], horizon_s)
    time_s = (events[moment.column] - events["arrived_s"]).clip(lower=0.0)
    is_censored = ~(time_s <= follow_s)
    return events.assign(time_s=time_s.where(~is_censored, follow_s), is_censored=is_censored)


def of_variant(events: pd.DataFrame, variant: str) -> pd.DataFrame:
    if events.empty:
        raise ValueError(NO_EVENTS)
    rows = events[events["variant"] == variant]
    if rows.empty:
        raise ValueError(f"events.csv has no events of {variant!r}")
    return rows


def lacking(study: Study, events: pd.DataFrame) -> list[str]:
    """Say what the table of events lacks of what the study asks about single events."""
    if not asked(study):
        return []
    wanted = asked_variants(study)
    lost = [name for name in wanted if events.empty or name not in set(events["variant"])]
    if len(lost) == len(wanted):
        return [f"{NO_EVENTS[0].upper()}{NO_EVENTS[1:]}: nothing is said of their times."]
    return [f"There are no events of {', '.join(map(repr, lost))}."] if lost else []


def kept(study: Study, events: pd.DataFrame, runs: pd.DataFrame) -> str:
    """Say of which replicates there are events, if not of all; empty if of all."""
    have, all_of = (sorted(set(rows["replicate"])) if len(rows) else [] for rows in (events, runs))
    if not have or have == all_of:
        return ""
    return (
        f"`events.csv` has the events of replicates {ranges([int(number) for number in have])} of {len(all_of)} "
        f"(`study.max_events` = {study.file.study.max_events})."
    )
