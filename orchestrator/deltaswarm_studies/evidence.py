"""All results of a study's runs, one table per kind: contrasts and claims, and here fits, grids and recovery."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from deltaswarm_orchestrator.sweeps.table import InvalidRun, invalid_line, read_table, write_table
from deltaswarm_studies import events as event_tables
from deltaswarm_studies import montecarlo, tables
from deltaswarm_studies.ceilings import undecided
from deltaswarm_studies.claim_settings import DEPENDS
from deltaswarm_studies.claims import claims_of, vacuous_claims
from deltaswarm_studies.contrasts import contrasts_of
from deltaswarm_studies.deciding import with_reopened
from deltaswarm_studies.metrics import ID, PER_EVENT
from deltaswarm_studies.origin import sealed_tables
from deltaswarm_studies.rings import rings_of
from deltaswarm_studies.sensitivity import sensitivity_of
from deltaswarm_studies.sentences import sentences_of
from deltaswarm_studies.settings import FitSettings, FitVerdict, GridSettings, RecoverySettings
from deltaswarm_studies.stats import Floats, describe, pairs_needed
from deltaswarm_studies.study import Study
from deltaswarm_studies.survival import survival_of
from deltaswarm_studies.tables import Row, column, samples_of

FIT_RESAMPLES = 4000
"""Bootstrap samples of the replicates for the closest fit, all variants alike, with seed 0."""

RECOVERY_RESAMPLES = 999
TAIL = 0.025

FEWER_IS_BETTER = (*PER_EVENT, "open_events")


class Finding(NamedTuple):
    """What a page says first, under a heading."""

    heading: str
    sentences: Sequence[str]
    remark: str


class Evidence:
    """All results of a study's runs, a table for each kind."""

    def __init__(
        self,
        study: Study,
        runs: pd.DataFrame,
        courses: pd.DataFrame,
        recovery: pd.DataFrame,
        invalid: Sequence[InvalidRun] = (),
        events: pd.DataFrame | None = None,
    ) -> None:
        """Evaluate the runs and their events; `courses` and `recovery`, which need the time series, are given.

        `invalid` are the runs that are no replicates. A variant with too many of them is shown and not judged.
        """
        self.runs, self.courses, self.recovery = runs, courses, recovery
        self.invalid = tables.invalid_of(runs, invalid)
        self.unjudged = tables.too_few(study, self.invalid)
        """Variants that are not judged, with their number of valid replicates."""
        self.means = tables.by_point(study, runs)
        """The runs; of a sensitivity study with several at a point, their means."""
        judged = self.means[~self.means["variant"].isin(self.unjudged)]
        self.estimates = tables.estimates_of(study, self.means)
        contrasts, claims, at_ceiling = undecided(
            study, judged, contrasts_of(study, judged), claims_of(study, judged, is_whole=not self.unjudged)
        )
        self.contrasts, self.claims = (with_reopened(rows) if len(rows) else rows for rows in (contrasts, claims))
        self.sensitivity = sensitivity_of(study, judged)
        self.events = pd.DataFrame(columns=event_tables.COLUMNS) if events is None else events
        self.survival = survival_of(study, self.events, self.unjudged)
        self.rings = rings_of(study, self.events)
        self.fits, self.grids = fits_of(study, judged), grids_of(study, judged, self.unjudged)
        results = {"claim": self.claims, "contrast": self.contrasts, "fit": self.fits}
        self.findings = [
            Finding(one.heading, [*_told(study, one.results, results)], " ".join(one.remark.split()))
            for one in study.file.finding
        ]
        """What the page says first."""
        self.arrivals = tables.same_arrivals(study, runs)
        """Whether compared runs saw the same arrivals, a clause for each thing that was checked."""
        self.incomplete = [
            *self._invalid_lines(study),
            *tables.missing_runs(study, runs, self.invalid),
            *tables.missing_metrics(study, runs),
            *event_tables.lacking(study, self.events),
        ]
        """What the tables lack of what the study asks."""
        self.undrawn: list[str] = []
        """Figures that could not be drawn, with the reason; known when the page is made."""
        self.doubts = [
            *too_few(study, self.contrasts),
            *too_few_for(study, self.claims),
            *vacuous_claims(study, judged),
            *at_ceiling,
            *tables.part_of_points(study),
            *study.left_out,
        ]
        """Contrasts and claims with too few replicates, claims that nothing could contradict, verdicts at a ceiling,
        and what is left out."""

    def _invalid_lines(self, study: Study) -> list[str]:
        """Say which runs are no replicates, and which variants are not judged for that."""
        if self.invalid.empty:
            return []
        left = "; ".join(f"{label} ({count} of {study.sweep.repeats[label]})" for label, count in self.unjudged.items())
        nothing = f"Too few replicates are left, so nothing is judged of {left}." if left else ""
        line = invalid_line(self.invalid.to_dict("records"), sum(study.sweep.repeats.values()))
        return [line, *([nothing] if nothing else [])]

    @classmethod
    def of_sweep(
        cls,
        study: Study,
        table: pd.DataFrame,
        series: pd.DataFrame,
        invalid: Sequence[InvalidRun] = (),
        events: pd.DataFrame | None = None,
    ) -> "Evidence":
        """Evaluate the tables of a sweep, its runs that are no replicates, and its events."""
        windows = tables.windows_with_levels(study, series)
        runs, courses = tables.runs_of(study, table, series), tables.courses_of(study, windows)
        unjudged = tables.too_few(study, tables.invalid_of(runs, invalid))
        recovery = recovery_of(study, windows[~windows["variant"].isin(unjudged)])
        return cls(study, runs, courses, recovery, invalid, events)

    @classmethod
    def of_folder(cls, study: Study, folder: Path) -> "Evidence":
        """Evaluate the tables that `save` wrote, perhaps for an earlier version of the study.

        Raises:
            OSError: If there is no `runs.csv`.
            SealError: If a table is not as it was sealed.
            ValueError: If a table cannot be read, or has none of the study's variants.
        """
        sealed_tables(folder, study)
        labels = ["variant", "metric", "level", "reference", "within", *tables.ORIGIN, *study.factors]
        labels += [one.name for one in study.ranges if one.choices]
        runs = read_table(folder / "runs.csv", labels, needs=ID)
        for name in runs.columns.intersection([*tables.ORIGIN]):
            runs[name] = runs[name].where(runs[name] != "")
        runs = tables.with_levels(study, runs[runs["variant"].isin(study.levels)].reset_index(drop=True))
        if runs.empty:
            raise ValueError(
                f"{folder / 'runs.csv'} must have runs of the study's variants, such as {next(iter(study.levels))!r}"
            )
        courses, recovery, invalid, events = (
            read_table(file, labels) if (file := folder / f"{name}.csv").exists() else pd.DataFrame()
            for name in ("courses", "recovery", "invalid", "events")
        )
        return cls(study, runs, courses, recovery, invalid.to_dict("records"), events)

    @property
    def surprises(self) -> list[str]:
        """Claims that are unexpectedly refuted, or depend on the metric."""
        if self.claims.empty:
            return []
        is_wrong = self.claims["verdict"].isin(["refuted", "differs", DEPENDS])
        wrong = self.claims[is_wrong & (self.claims["expect"] != self.claims["verdict"])]
        return [f"{row['claim']}: {row['text']}" for _, row in wrong.iterrows()]

    @property
    def warnings(self) -> list[str]:
        """Warnings that a reader must not miss."""
        return [*self.incomplete, *self.undrawn, *self.doubts]

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Every table by the name of its file."""
        frames = {name: getattr(self, name) for name in tables.OF_RESULTS}
        own = tables.OF_SENSITIVITY if self.sensitivity else ()
        return frames | {name: getattr(self.sensitivity, name) for name in own}

    def save(self, folder: Path) -> list[Path]:
        """Write every table that has rows; return the files."""
        for file in folder.glob("invalid.*"):  # of earlier runs, which have been repeated
            file.unlink()
        return [file for name, frame in self.tables.items() if len(frame) for file in write_table(folder / name, frame)]


def _told(study: Study, chosen: Sequence[Mapping[str, Any]], results: Mapping[str, pd.DataFrame]) -> Iterator[str]:
    for one in chosen:
        yield from sentences_of(study, one, results)


def too_few(study: Study, contrasts: pd.DataFrame) -> list[str]:
    """List contrasts that could not have become significant, however large the effect."""
    if contrasts.empty:
        return []
    over = [settings.id for settings in study.file.contrast if settings.over]
    contrasts = contrasts[~contrasts["contrast"].isin(over)]
    tested = contrasts.groupby(["contrast", "family", "metric"], sort=False)["n"].max().reset_index()
    needed = tested["family"].map(pairs_needed)
    tested = tested.assign(needed=needed)[(tested["n"] > 0) & (tested["n"] < needed)]
    texts = {settings.id: settings.text or settings.id for settings in study.file.contrast}
    return [
        f"n = {most} can show nothing of {'; '.join(study.metrics[metric].title for metric in rows['metric'])} "
        f"in the contrast {texts[str(name)]!r}: Holm's "
        f"correction over {family} comparisons needs at least {least}."
        for (name, family, most, least), rows in tested.groupby(["contrast", "family", "n", "needed"], sort=False)
    ]


def too_few_for(study: Study, claims: pd.DataFrame) -> list[str]:
    """List sources whose claims could not have been decided, whatever the runs had shown."""
    if claims.empty:
        return []
    over = [claim.id for claim in study.file.claim if claim.over]
    tested = claims[(claims["n"] > 0) & claims["published"].isna() & ~claims["claim"].isin(over)]
    most = tested.groupby(["source", "family"], sort=False)["n"].max().reset_index()
    few = most[most["n"] < most["family"].map(pairs_needed)]
    return [
        f"n = {row['n']} can show nothing of the claims{' of ' * bool(row['source'])}{row['source']}: Holm's "
        f"correction over {row['family']} claims needs at least {pairs_needed(row['family'])}."
        for _, row in few.iterrows()
    ]


def fits_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per fit, combination of the other factors and target, the closest combination first.

    `distance` is from the median to the published one, in published interquartile ranges; `sum` adds the squares of a
    combination's distances, `without` those of all targets but the row's. `closest` is the share of bootstrap samples
    of the replicates in which its sum is smallest; `verdict` says whether its sum is the smallest of all replicates,
    unless one of the combinations has no data.
    """
    rows: list[Row] = []
    for fit in study.file.fit:
        cells = study.cells([fit.factor])
        distances = np.stack([_distances(study, runs, fit, cell) for cell in cells])
        sums = (distances**2).sum(axis=1)
        winners = np.bincount(sums[:, 1:].argmin(axis=0), minlength=len(cells)) / FIT_RESAMPLES
        for rank, place in enumerate(sums[:, 0].argsort(kind="stable")):
            head = {"fit": fit.text, "within": ", ".join(cells[place].values())}
            verdict: FitVerdict = "farther" if rank else "closest" if np.isfinite(sums[:, 0]).all() else "no data"
            tail = {"sum": float(sums[place, 0]), "closest": float(winners[place]), "verdict": verdict}
            tail |= {"sum_mcse": montecarlo.of_resampled(sums[place, 1:])}
            rows += [
                {**head, "level": target.level, "metric": target.metric, "distance": float(own[0])}
                | {
                    "mcse": montecarlo.of_resampled(own[1:]),
                    **tail,
                    "without": float(np.sum(np.delete(distances[place, :, 0], number) ** 2)),
                }
                for number, (target, own) in enumerate(zip(fit.targets, distances[place], strict=True))
            ]
    return pd.DataFrame(rows)


def _distances(study: Study, runs: pd.DataFrame, fit: FitSettings, cell: dict[str, str]) -> Floats:
    """Return the distance to each target (rows), of all replicates and of each bootstrap sample (columns).

    Variants with the same number of replicates are resampled together, since they saw the same arrivals.
    """
    distances = []
    for target in fit.targets:
        levels = {**cell, fit.factor: target.level}
        variant = next(name for name, own_levels in study.levels.items() if own_levels == levels)
        repeats = study.repeats_of([variant])
        values = samples_of(runs, target.metric)(variant).reindex(range(repeats)).to_numpy(float)
        if np.isnan(values).all():
            distances.append(np.full(FIT_RESAMPLES + 1, math.inf))
            continue
        picks = np.random.default_rng(0).integers(repeats, size=(FIT_RESAMPLES, repeats))
        medians = np.append(np.nanmedian(values), np.nanmedian(values[picks], axis=1))
        distances.append((medians - target.says) / target.iqr)
    return np.stack(distances)


def grids_of(study: Study, runs: pd.DataFrame, unjudged: Collection[str] = ()) -> pd.DataFrame:
    """Make a row per grid, row and column: the lowest median of the column's levels, its interval, and the level.

    A cell to which a variant belongs that is not judged is left out.
    """
    rows: list[Row] = []
    for grid in study.file.grid:
        values = runs.assign(value=column(runs, grid.metric))
        for row in study.factors[grid.rows]:
            for heading, levels in grid.columns.items():
                cells = values[(values[grid.rows] == row) & values[grid.factor].isin(levels)].groupby(grid.factor)[
                    "value"
                ]
                medians = {str(level): describe(cell) for level, cell in cells}
                known = {level: cell.median for level, cell in medians.items() if cell.median is not None}
                if known and not any(_is_in(study.levels[name], grid, row, levels) for name in unjudged):
                    best = min(known, key=known.__getitem__)
                    head = {"grid": grid.text, "metric": grid.metric, "row": row, "column": heading, "level": best}
                    shown = {name: getattr(medians[best], name) for name in ("n", "median", "low", "high")}
                    rows.append(head | shown | {"mcse": montecarlo.of_median(cells.get_group(best))})
    return pd.DataFrame(rows)


def _is_in(variant: Mapping[str, str], grid: GridSettings, row: str, levels: Collection[str]) -> bool:
    return variant[grid.rows] == row and variant[grid.factor] in levels


def recovery_of(study: Study, windows: pd.DataFrame) -> pd.DataFrame:
    """Make a row per cell: n replicates, and the time `back_s` from `after_s` on, with its interval [s].

    In each window, the mean over the replicates is compared with the mean of the same replicates without the fault,
    which saw the same arrivals. The swarm is back at the end of the first of `windows` consecutive windows that lie
    within the tolerance: times and open events are not more, other metrics are neither more nor less. `back_s` is inf
    if the swarm is not back before the end, NaN if nothing is known. The interval is a percentile bootstrap over
    replicates.
    """
    rows = [
        {
            "metric": settings.metric,
            "level": settings.level,
            "reference": settings.reference,
            "within": ", ".join(cell.values()),
            **_cell(settings, cell, windows, study.file.study.window_s),
        }
        for settings in study.file.recovery
        for cell in study.cells([settings.factor])
    ]
    return pd.DataFrame(rows)


def _cell(settings: RecoverySettings, cell: dict[str, str], windows: pd.DataFrame, window_s: float) -> dict[str, Any]:
    rows = windows[windows["time_s"] >= settings.after_s - 1e-9 * window_s]
    for factor, level in cell.items():
        rows = rows[rows[factor] == level]
    # Means over events are weighted by events, other metrics by 1.
    values, weights = rows[settings.metric], rows["events"] if settings.metric in PER_EVENT else 1.0
    rows = rows.assign(total=(values * weights).fillna(0.0), weight=values.notna() * weights)
    tables = [
        rows[rows[settings.factor] == level]
        .pivot_table(index="replicate", columns="time_s", values=name, dropna=False)
        .fillna(0.0)
        for level in (settings.level, settings.reference)
        for name in ("total", "weight")
    ]
    replicates = tables[0].index.intersection(tables[2].index)
    times_s = tables[0].columns.intersection(tables[2].columns)
    sums = np.stack([table.loc[replicates, times_s].to_numpy(float) for table in tables])
    count = len(replicates)
    if not count or len(times_s) < settings.windows:
        return {"n": count, "back_s": math.nan, "mcse_s": math.nan, "low_s": math.nan, "high_s": math.nan}
    ends_s = times_s.to_numpy(float) + window_s
    low_s, high_s, mcse_s = math.nan, math.nan, math.nan
    if count > 1:
        generator = np.random.default_rng(0)
        drawn = (generator.integers(count, size=count) for _ in range(RECOVERY_RESAMPLES))
        resampled_s = np.sort([_back_s(settings, sums[:, chosen], ends_s) for chosen in drawn])
        # By rank, not by interpolation: there is no value between 300 s and never.
        ranks = math.floor(TAIL * (RECOVERY_RESAMPLES - 1)), math.ceil((1 - TAIL) * (RECOVERY_RESAMPLES - 1))
        low_s, high_s = (float(resampled_s[rank]) for rank in ranks)
        mcse_s = montecarlo.of_resampled(resampled_s)
    back_s = _back_s(settings, sums, ends_s)
    return {"n": count, "back_s": back_s, "mcse_s": mcse_s, "low_s": low_s, "high_s": high_s}


def _back_s(settings: RecoverySettings, sums: Floats, ends_s: Floats) -> float:
    """Compute when the swarm is back, counted from `after_s` [s].

    Args:
        settings: what counts as being back.
        sums: (4, replicates, windows) sums and weights with the fault, then without it.
        ends_s: (windows,) the end of each window [s].
    """
    totals = sums.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        fault, reference = totals[::2] / totals[1::2]
        ratios = np.where((fault == 0) & (reference == 0), 1.0, fault / reference)
    least = 0.0 if settings.metric in FEWER_IS_BETTER else 1 / settings.tolerance
    is_well = (ratios <= settings.tolerance) & (ratios >= least)
    is_back = np.lib.stride_tricks.sliding_window_view(is_well, settings.windows).all(axis=1)
    return float(ends_s[is_back.argmax()]) - settings.after_s if is_back.any() else math.inf
