"""All that a study's runs show, a table for each kind of result."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from deltaswarm_orchestrator.significance import pairs_needed
from deltaswarm_orchestrator.studies.claims import claims_of, findings_of, vacuous_claims
from deltaswarm_orchestrator.studies.contrasts import contrasts_of, disagreements
from deltaswarm_orchestrator.studies.fits import fits_of, grids_of
from deltaswarm_orchestrator.studies.metrics import ID
from deltaswarm_orchestrator.studies.recovery import recovery_of
from deltaswarm_orchestrator.studies.settings import CLAIM, CONTRAST, FIT, REFUTED
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_orchestrator.studies.tables import (
    ORIGIN,
    courses_of,
    estimates_of,
    missing_metrics,
    missing_runs,
    runs_of,
    same_arrivals,
    windows_with_levels,
)
from deltaswarm_orchestrator.sweeps.table import read_table, write_table


@dataclass(frozen=True)
class Evidence:
    """All results of a study's runs, a table each."""

    runs: pd.DataFrame
    courses: pd.DataFrame
    recovery: pd.DataFrame
    estimates: pd.DataFrame
    contrasts: pd.DataFrame
    claims: pd.DataFrame
    findings: pd.DataFrame
    fits: pd.DataFrame
    grids: pd.DataFrame
    arrivals: list[str]
    """Whether compared runs saw the same arrivals, a clause for each thing that was checked."""
    incomplete: list[str]
    """What the tables lack of what the study asks."""
    contradictions: list[str]
    """Comparisons of waiting whose direction reverses when events that were never sensed are counted."""
    doubts: list[str]
    """Contrasts with too few replicates, and claims that nothing could contradict."""

    @classmethod
    def of(cls, study: Study, runs: pd.DataFrame, courses: pd.DataFrame, recovery: pd.DataFrame) -> "Evidence":
        """Evaluate the runs; `courses` and `recovery`, which need the time series, are given."""
        contrasts, claims, fits = contrasts_of(study, runs), claims_of(study, runs), fits_of(study, runs)
        findings = findings_of(study, {CLAIM: claims, CONTRAST: contrasts, FIT: fits})
        lists = (
            same_arrivals(study, runs),
            [*missing_runs(study, runs), *missing_metrics(study, runs)],
            disagreements(study, runs),
            [*too_few(contrasts), *vacuous_claims(study, runs)],
        )
        tables = (contrasts, claims, findings, fits, grids_of(study, runs))
        return cls(runs, courses, recovery, estimates_of(study, runs), *tables, *lists)

    @classmethod
    def of_sweep(cls, study: Study, table: pd.DataFrame, series: pd.DataFrame) -> "Evidence":
        """Evaluate the tables of a sweep.

        Raises:
            ValueError: If the tables lack a column that the study needs.
        """
        windows = windows_with_levels(study, series)
        return cls.of(study, runs_of(study, table, series), courses_of(study, windows), recovery_of(study, windows))

    @classmethod
    def of_folder(cls, study: Study, folder: Path) -> "Evidence":
        """Evaluate the tables that `save` wrote, perhaps for an earlier version of the study.

        Raises:
            OSError: If there is no `runs.csv`.
            ValueError: If a table cannot be read, or has none of the study's variants.
        """
        labels = ["variant", "metric", "level", "reference", "within", *ORIGIN, *study.factors]
        runs = read_table(folder / "runs.csv", labels, needs=ID)
        for name in ORIGIN:
            runs[name] = runs[name].where(runs[name] != "") if name in runs else None
        runs = runs[runs["variant"].isin(study.levels)].reset_index(drop=True)
        if runs.empty:
            raise ValueError(
                f"{folder / 'runs.csv'} must have runs of the study's variants, such as {next(iter(study.levels))!r}"
            )
        for factor in study.factors:
            runs[factor] = runs["variant"].map({label: levels[factor] for label, levels in study.levels.items()})
        beside = [folder / f"{name}.csv" for name in ("courses", "recovery")]
        return cls.of(study, runs, *(read_table(file, labels) if file.exists() else pd.DataFrame() for file in beside))

    @property
    def surprises(self) -> list[str]:
        """Claims that are refuted unexpectedly."""
        if self.claims.empty:
            return []
        wrong = self.claims[(self.claims["verdict"] == REFUTED) & (self.claims["expect"] != REFUTED)]
        return [f"{row['claim']}: {row['text']}" for _, row in wrong.iterrows()]

    @property
    def warnings(self) -> list[str]:
        """Warnings that a reader must not miss."""
        return [*self.incomplete, *self.contradictions, *self.doubts]

    @property
    def unsupported(self) -> list[str]:
        """Findings that the results no longer support, with the reason."""
        broken = self.findings[self.findings["broken"] != ""]
        return [f"{row['broken']}: {row['text']}" for _, row in broken.iterrows()]

    def save(self, folder: Path) -> list[Path]:
        """Write every table that has rows, except the findings; return the files."""
        names = ("runs", "courses", "recovery", "estimates", "contrasts", "claims", "fits", "grids")
        frames = {name: getattr(self, name) for name in names}
        return [file for name, frame in frames.items() if len(frame) for file in write_table(folder / name, frame)]


def too_few(contrasts: pd.DataFrame) -> list[str]:
    """List contrasts that could not have become significant, however large the effect."""
    if contrasts.empty:
        return []
    families = contrasts.groupby(["contrast", "family", "metric"], sort=False)["n"].max().reset_index()
    found = []
    for (name, family, most), rows in families.groupby(["contrast", "family", "n"], sort=False):
        needed = pairs_needed(int(str(family)))
        if 0 < int(str(most)) < needed:
            found.append(
                f"{most} replicates can show nothing of {', '.join(rows['metric'])} in the contrast {name!r}: Holm's "
                f"correction over {family} comparisons needs at least {needed}."
            )
    return found
