"""All that a study's runs show, a table for each kind of result."""

from pathlib import Path

import pandas as pd

from deltaswarm_orchestrator.sweeps.table import read_table, write_table
from deltaswarm_studies import tables
from deltaswarm_studies.claims import claims_of, findings_of, vacuous_claims
from deltaswarm_studies.contrasts import contrasts_of, disagreements
from deltaswarm_studies.fits import fits_of, grids_of
from deltaswarm_studies.metrics import ID
from deltaswarm_studies.recovery import recovery_of
from deltaswarm_studies.significance import pairs_needed
from deltaswarm_studies.study import Study


class Evidence:
    """All results of a study's runs, a table for each kind."""

    def __init__(self, study: Study, runs: pd.DataFrame, courses: pd.DataFrame, recovery: pd.DataFrame) -> None:
        """Evaluate the runs; `courses` and `recovery`, which need the time series, are given."""
        self.runs, self.courses, self.recovery = runs, courses, recovery
        self.estimates = tables.estimates_of(study, runs)
        self.contrasts = contrasts_of(study, runs)
        self.claims = claims_of(study, runs)
        self.fits, self.grids = fits_of(study, runs), grids_of(study, runs)
        self.findings = findings_of(study, {"claim": self.claims, "contrast": self.contrasts, "fit": self.fits})
        self.arrivals = tables.same_arrivals(study, runs)
        """Whether compared runs saw the same arrivals, a clause for each thing that was checked."""
        self.incomplete = [*tables.missing_runs(study, runs), *tables.missing_metrics(study, runs)]
        """What the tables lack of what the study asks."""
        self.contradictions = disagreements(study, runs)
        """Comparisons of waiting whose direction reverses when events that were never sensed are counted."""
        self.doubts = [*too_few(self.contrasts), *vacuous_claims(study, runs)]
        """Contrasts with too few replicates, and claims that nothing could contradict."""

    @classmethod
    def of_sweep(cls, study: Study, table: pd.DataFrame, series: pd.DataFrame) -> "Evidence":
        """Evaluate the tables of a sweep.

        Raises:
            ValueError: If the tables lack a column that the study needs.
        """
        windows = tables.windows_with_levels(study, series)
        runs, courses = tables.runs_of(study, table, series), tables.courses_of(study, windows)
        return cls(study, runs, courses, recovery_of(study, windows))

    @classmethod
    def of_folder(cls, study: Study, folder: Path) -> "Evidence":
        """Evaluate the tables that `save` wrote, perhaps for an earlier version of the study.

        Raises:
            OSError: If there is no `runs.csv`.
            ValueError: If a table cannot be read, or has none of the study's variants.
        """
        labels = ["variant", "metric", "level", "reference", "within", *tables.ORIGIN, *study.factors]
        runs = read_table(folder / "runs.csv", labels, needs=ID)
        for name in tables.ORIGIN:
            runs[name] = runs[name].where(runs[name] != "") if name in runs else None
        runs = tables.with_levels(study, runs[runs["variant"].isin(study.levels)].reset_index(drop=True))
        if runs.empty:
            raise ValueError(
                f"{folder / 'runs.csv'} must have runs of the study's variants, such as {next(iter(study.levels))!r}"
            )
        beside = [folder / f"{name}.csv" for name in ("courses", "recovery")]
        return cls(study, runs, *(read_table(file, labels) if file.exists() else pd.DataFrame() for file in beside))

    @property
    def surprises(self) -> list[str]:
        """Claims that are refuted unexpectedly."""
        if self.claims.empty:
            return []
        wrong = self.claims[(self.claims["verdict"] == "refuted") & (self.claims["expect"] != "refuted")]
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
    tested = contrasts.groupby(["contrast", "family", "metric"], sort=False)["n"].max().reset_index()
    needed = tested["family"].map(pairs_needed)
    tested = tested.assign(needed=needed)[(tested["n"] > 0) & (tested["n"] < needed)]
    return [
        f"{most} replicates can show nothing of {', '.join(rows['metric'])} in the contrast {name!r}: Holm's "
        f"correction over {family} comparisons needs at least {least}."
        for (name, family, most, least), rows in tested.groupby(["contrast", "family", "n", "needed"], sort=False)
    ]
