"""Single events on a study's page: Kaplan-Meier curves, rings around the densest place, tables."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from deltaswarm_studies.drawing import Drawing
from deltaswarm_studies.event_checks import MOMENTS, horizon_s
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.looks import of_groups
from deltaswarm_studies.panels import Frame, handle, handles, hues, panels, points
from deltaswarm_studies.rendering import MISSING, Table, decimals_for, number, p_value, table, with_interval
from deltaswarm_studies.rings import ring_rows
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.study import Study
from deltaswarm_studies.style import Look
from deltaswarm_studies.survival import Survival
from deltaswarm_studies.tables import with_levels
from deltaswarm_studies.verdicts import known

APART = 0.012
"""Distance between lines with intervals, as a share of the horizontal axis."""


def survival(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw the share of events whose moment has not come, over the time since they arrived, with 95 % bands."""
    moment, followed_s = MOMENTS[settings.metric], horizon_s(study, settings)

    def course(variant: str) -> pd.DataFrame:
        found = Survival.of(evidence.events, variant, moment, followed_s)
        return found.band.assign(runs=len(found.runs))

    def draw(axes: Axes, rows: pd.DataFrame, look: Look, place: float) -> None:
        times_s, colour = rows["time_s"], look.colour
        axes.step(times_s, rows["share"], where="post", color=colour, linestyle=look.line, linewidth=1.2)
        axes.fill_between(times_s, rows["low"], rows["high"], step="post", color=colour, alpha=0.2, linewidth=0)
        axes.margins(x=0)

    labels = "time since arrival [s]", f"events not yet {moment.state} [share]"
    told = "Kaplan-Meier curves of all events; bands are 95 % intervals over {n} runs."
    return _lines(settings, study, evidence, course, draw, labels, told)


def rings(settings: FigureSettings, study: Study, evidence: Evidence) -> Drawing:
    """Draw the mean time of each ring around the densest place: medians over the runs with exact 95 % intervals."""

    def course(variant: str) -> pd.DataFrame:
        return pd.DataFrame(ring_rows(study, settings, evidence.events, variant))

    def draw(axes: Axes, rows: pd.DataFrame, look: Look, place: float) -> None:
        middle, low, high = (rows[name].to_numpy(np.float64) for name in ("time_s", "time_low_s", "time_high_s"))
        points(axes, rows["mean_m"] + place * APART * np.ptp(rows["mean_m"]), middle, low, high, look)

    labels = "distance from the densest place [m]", f"mean time until {MOMENTS[settings.metric].state} [s]"
    told = "Rings with the same number of events; medians of {n} runs' means with exact 95 % intervals, if any."
    return _lines(settings, study, evidence, course, draw, labels, told)


def _lines(
    settings: FigureSettings,
    study: Study,
    evidence: Evidence,
    course: Callable[[str], pd.DataFrame],
    draw: Callable[[Axes, pd.DataFrame, Look, float], None],
    labels: tuple[str, str],
    told: str,
) -> Drawing:
    """Draw a line for each level of the hue; without a hue, for each variant. `draw` gets its place beside others."""
    variants = settings.variants or list(study.levels)
    rows = pd.concat([course(name).assign(variant=name) for name in variants], ignore_index=True)
    rows = with_levels(study, rows.assign(**{settings.metric: 0.0}))  # the vertical axis begins at 0
    marker = settings.kind == "rings"
    if settings.hue:
        looks = hues(settings, study, rows)
        legend = handles(study, settings.hue, looks, marker=marker)
    else:
        looks = of_groups(study, {name: [name] for name in variants})
        legend = [handle(look, study.variant_title(name), marker=marker) for name, look in looks.items()]

    def panel(axes: Axes, shown: pd.DataFrame) -> None:
        for index, (name, look) in enumerate(looks.items()):
            line = shown[shown[settings.hue or "variant"] == name]
            if len(line):
                draw(axes, line, look, index - (len(looks) - 1) / 2)

    frame = Frame(labels[0], legend, study.legend_title(settings.hue) if settings.hue else "", y_label=labels[1])
    counts = f"{rows['runs'].min()}" + (f" to {rows['runs'].max()}" if rows["runs"].nunique() > 1 else "")
    return Drawing(panels(settings, study, evidence, rows, panel, frame), (told.format(n=counts),))


def survival_tables(study: Study, rows: pd.DataFrame) -> Iterator[Table]:
    for settings in study.file.survival:
        own = rows[(rows["survival"] == settings.text) & (rows["metric"] == settings.metric)]
        if own.empty:
            continue
        followed_s = horizon_s(study, settings)
        shown = own[["runs", "events"]].assign(
            variant=own["variant"].map(study.variant_title),
            came=[f"{100 * row['came'] / row['events']:.1f}" for _, row in own.iterrows()],
            **{
                name: [_within(row, name, followed_s) for _, row in own.iterrows()]
                for name in ("mean", "median", "p95")
            },
        )
        headings = {
            "variant": "Variant",
            "runs": "Runs",
            "events": "Events",
            "came": f"{_capital(MOMENTS[settings.metric].state)} within {followed_s:g} s and the run [% of events]",
            "mean": f"Mean to {followed_s:g} s [s]",
            "median": "Median [s]",
            "p95": "95th percentile [s]",
        }
        if settings.reference and "difference_n" in own:
            shown["difference"] = [_difference(row) for _, row in own.iterrows()]
            for name in ("difference", "log_rank"):
                shown[f"{name}_p"] = [_p(row[f"{name}_p_holm"]) for _, row in own.iterrows()]
            headings["difference"] = f"Mean against {study.variant_title(settings.reference)} [s]"
            headings |= {"difference_p": "p (Holm)", "log_rank_p": "log-rank p (Holm)"}
        yield table(shown, headings, settings.text or study.metrics[settings.metric].title)


def ring_tables(study: Study, rows: pd.DataFrame) -> Iterator[Table]:
    """Make a table for each `[[rings]]`: a row per ring, a column per variant."""
    for settings in study.file.rings:
        own = rows[(rows["rings"] == settings.text) & (rows["metric"] == settings.metric)]
        if own.empty:
            continue
        cells = [_within(row, "time", horizon_s(study, settings)) for _, row in own.iterrows()]
        variants = list(dict.fromkeys(own["variant"]))
        wide = own.assign(cell=cells).pivot(index="ring", columns="variant", values="cell")[variants].fillna(MISSING)
        first = own[own["variant"] == variants[0]].set_index("ring")
        wide["from"] = [f"{row['from_m']:.1f} to {row['until_m']:.1f}" for _, row in first.iterrows()]
        wide["events"] = first["events"]
        title = f"{settings.text or 'By distance'}: {study.metrics[settings.metric].label}"
        headings = {
            "from": "Distance [m]",
            "events": "Events",
            **{name: study.variant_title(name) for name in variants},
        }
        yield table(wide.reset_index(), headings, title)


def _within(row: Any, name: str, horizon_s: float) -> str:
    """Format a time with its interval; times beyond the horizon are shown as longer than the horizon."""
    ends = [known(row[f"{name}{side}_s"]) for side in ("", "_low", "_high")]
    decimals = decimals_for(ends)
    value, low, high = (f"> {horizon_s:g}" if end and end >= horizon_s else number(end, decimals) for end in ends)
    if error := known(row.get(f"{name}_mcse_s")):
        value += f" ({number(error, max(decimals, decimals_for([error]) - 1))})"
    return value if MISSING in (low, high) or value == low == high else f"{value} [{low}, {high}]"


def _difference(row: Any) -> str:
    return with_interval(*(known(row[f"difference{side}"]) for side in ("", "_low", "_high")))


def _p(value: Any) -> str:
    return MISSING if pd.isna(value) else p_value(float(value))


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]
