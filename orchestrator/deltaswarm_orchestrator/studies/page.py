"""Build a study's page: its tables and figures, in the order in which a reader asks."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from deltaswarm_orchestrator.report import words
from deltaswarm_orchestrator.report.page import Picture, Table, render, table
from deltaswarm_orchestrator.report.plots import style
from deltaswarm_orchestrator.report.plots.swarm import swarm
from deltaswarm_orchestrator.stats import pairs_needed
from deltaswarm_orchestrator.studies.charts import CHARTS
from deltaswarm_orchestrator.studies.evidence import (
    claims_of,
    contrasts_of,
    courses_of,
    disagreements,
    estimates_of,
    findings_of,
    runs_of,
    windows_with_levels,
)
from deltaswarm_orchestrator.studies.metrics import ID
from deltaswarm_orchestrator.studies.recovery import recovery_of
from deltaswarm_orchestrator.studies.snapshot import snapshot
from deltaswarm_orchestrator.studies.study import HOLDS, REFUTED, UNDECIDED, FigureSettings, Study
from deltaswarm_orchestrator.sweeps.table import read_table, write_table
from deltaswarm_wire.files import write_whole

PROVENANCE = {"what": "What", "value": "Value"}
"""Columns of the table of where runs come from, with their headings."""


@dataclass(frozen=True)
class Section:
    """A heading with its tables and pictures."""

    heading: str
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)


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
    contradictions: list[str]
    """Comparisons of waiting whose direction reverses when events that were never sensed are counted."""
    doubts: list[str]
    """Contrasts with too few replicates."""

    @classmethod
    def of(cls, study: Study, runs: pd.DataFrame, courses: pd.DataFrame, recovery: pd.DataFrame) -> "Evidence":
        """Evaluate the runs; `courses` and `recovery`, which need the time series, are given."""
        contrasts, claims = contrasts_of(study, runs), claims_of(study, runs)
        findings = findings_of(study, claims, contrasts)
        doubts = [*disagreements(study, runs)], too_few(contrasts)
        return cls(runs, courses, recovery, estimates_of(study, runs), contrasts, claims, findings, *doubts)

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
        """Evaluate the tables that `save` wrote.

        Raises:
            OSError: If there is no `runs.csv`.
            ValueError: If a table cannot be read, or lacks a factor or metric of the study.
        """
        labels = ["variant", "metric", "level", "reference", "within", *study.factors]
        metrics = {*study.file.study.metrics, *itertools.chain(*map(study.metrics_of, study.file.contrast))}
        runs = read_table(folder / "runs.csv", labels, needs=[*ID, *study.factors, *sorted(metrics)])
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
        return [*self.contradictions, *self.doubts]

    @property
    def unsupported(self) -> list[str]:
        """Findings that the results no longer support, with the reason."""
        broken = self.findings[self.findings["broken"] != ""]
        return [f"{row['broken']}: {row['text']}" for _, row in broken.iterrows()]

    def save(self, folder: Path) -> list[Path]:
        """Write every table that has rows, except the findings; return the files."""
        frames = {
            name: getattr(self, name) for name in ("runs", "courses", "recovery", "estimates", "contrasts", "claims")
        }
        return [file for name, frame in frames.items() if len(frame) for file in write_table(folder / name, frame)]


def too_few(contrasts: pd.DataFrame) -> list[str]:
    """List contrasts that could not have become significant, however large the effect."""
    if contrasts.empty:
        return []
    found = []
    for (name, family), rows in contrasts.groupby(["contrast", "family"], sort=False):
        most, needed = rows["n"].max(), pairs_needed(int(str(family)))
        if 0 < most < needed:
            found.append(
                f"{most} replicates can show nothing in the contrast {name!r}: Holm's correction over {family} "
                f"comparisons needs at least {needed}."
            )
    return found


def pages(study: Study, evidence: Evidence, provenance: pd.DataFrame) -> tuple[str, str, list[Picture]]:
    """Make the page as HTML and as Markdown, and its pictures."""
    pictures, lacking = [], []
    for figure in study.file.figure:
        try:
            if drawing := _drawn(study, evidence, figure):
                pictures.append(Picture(figure.name, drawing, " ".join(figure.caption.split())))
        except ValueError as error:  # a page without a figure is better than none
            lacking.append(f"The figure {figure.name!r} is missing: {error}.")
    supported = evidence.findings[evidence.findings["broken"] == ""]["text"]
    context: dict[str, Any] = {
        "title": study.title,
        "question": " ".join(study.file.study.question.split()),
        "findings": [" ".join(text.split()) for text in supported],
        "warnings": [*evidence.warnings, *lacking],
        "sections": [one for one in _sections(study, evidence, pictures, provenance) if one.tables or one.pictures],
        "verdicts": _counts(evidence.claims),
        "figures": "figures",
    }
    return render("page.html.jinja", context), render("page.md.jinja", context), pictures


def _drawn(study: Study, evidence: Evidence, figure: FigureSettings) -> Figure | None:
    """Draw a figure; return None if there is no data for it."""
    if figure.kind == "swarm":
        return _swarm(study, figure)
    rows = evidence.courses if figure.kind == "time" else evidence.runs
    if rows.empty or (figure.variants and not rows["variant"].isin(figure.variants).any()):
        return None
    return CHARTS[figure.kind](figure, study, rows)


def _swarm(study: Study, figure: FigureSettings) -> Figure:
    scenarios = {variant.label: variant.scenario for variant in study.sweep.variants}
    shots = {name: snapshot(replace(scenarios[name], seed=figure.seed), figure.at_s) for name in figure.variants}
    return swarm(shots)


def _sections(study: Study, evidence: Evidence, pictures: list[Picture], provenance: pd.DataFrame) -> Iterator[Section]:
    if len(evidence.claims):
        yield Section("Verdicts", [_claims(study, evidence.claims), *_reasons(evidence)])
    yield Section("Figures", pictures=pictures)
    if len(evidence.contrasts):
        yield Section("Contrasts", list(_contrasts(study, evidence.contrasts)))
    if len(evidence.recovery):
        yield Section("Recovery", [_recovered(study, evidence.recovery)])
    yield Section("Estimates", [_estimates(study, evidence)])
    yield Section("Where this comes from", [table(provenance, PROVENANCE)])


def _counts(claims: pd.DataFrame) -> dict[str, int]:
    """Count the claims with each verdict."""
    found = claims["verdict"].tolist() if len(claims) else []
    return {verdict: found.count(verdict) for verdict in (HOLDS, REFUTED, UNDECIDED)}


def _claims(study: Study, claims: pd.DataFrame) -> Table:
    order = {REFUTED: 0, UNDECIDED: 1, HOLDS: 2}
    rows = claims.sort_values("verdict", key=lambda verdicts: verdicts.map(order), kind="stable").copy()
    units = {name: metric.unit for name, metric in study.metrics.items()}
    rows["found"] = [_estimate(row, units[row["metric"]]) for _, row in rows.iterrows()]
    p = rows["p_holm"].where(rows["p_holm"].notna(), rows["p_opposite_holm"])
    rows["p"] = ["" if pd.isna(value) else words.p_value(float(value)) for value in p]
    headings = {"text": "Claim", "verdict": "Verdict", "says": "Published", "criterion": "Criterion", "found": "Here"}
    return table(rows, {**headings, "p": "p (Holm)", "source": "Source"})


def _reasons(evidence: Evidence) -> Iterator[Table]:
    rows = evidence.claims[(evidence.claims["why"] != "") & (evidence.claims["verdict"] != HOLDS)]
    if len(rows):
        yield table(rows[["text", "why"]], {"text": "Claim", "why": "What is known about why"})


def _contrasts(study: Study, contrasts: pd.DataFrame) -> Iterator[Table]:
    texts = {one.id: one.text for one in study.file.contrast}
    for (name, metric), rows in contrasts.groupby(["contrast", "metric"], sort=False):
        shown = rows.copy()
        shown["found"] = [_estimate(row, study.metrics[str(metric)].unit) for _, row in rows.iterrows()]
        shown["p"] = [words.p_value(float(p)) for p in rows["p_holm"]]
        headings = {"level": "Level", "reference": "Against", **({"within": "Within"} if any(rows["within"]) else {})}
        title = (
            f"{texts[str(name)] or name}: {study.metrics[str(metric)].title.lower()} ({rows['family'].iloc[0]} tests)"
        )
        yield table(shown, {**headings, "n": "n", "found": "Estimate", "p": "p (Holm)", "verdict": "Verdict"}, title)


def _recovered(study: Study, recovery: pd.DataFrame) -> Table:
    rows = recovery.copy()
    rows["metric"] = [study.metrics[name].title for name in rows["metric"]]
    for name in ("back_s", "low_s", "high_s"):
        rows[name] = ["not by the end" if value == float("inf") else words.number(value, 0) for value in rows[name]]
    rows["interval"] = [f"{row['low_s']} to {row['high_s']}" for _, row in rows.iterrows()]
    headings = {"metric": "Metric", "level": "Level", "reference": "Against", "within": "Within", "n": "n"}
    return table(rows, {**headings, "back_s": "Back after [s]", "interval": "95 % interval [s]"})


def _estimates(study: Study, evidence: Evidence) -> Table:
    rows = evidence.estimates.copy()
    metrics = list(dict.fromkeys(rows["metric"]))
    rows["found"] = [
        words.with_interval(_known(row["median"]), _known(row["low"]), _known(row["high"]))
        for _, row in rows.iterrows()
    ]
    wide = rows.pivot(index="variant", columns="metric", values="found").loc[rows["variant"].unique()].reset_index()
    wide["n"] = rows.groupby("variant")["n"].max().loc[wide["variant"]].to_numpy()
    return table(wide, {"variant": "Variant", "n": "n", **{name: study.metrics[name].label for name in metrics}})


def _estimate(row: Any, unit: str) -> str:
    value, low, high = (_known(row[name]) for name in ("estimate", "low", "high"))
    shown = words.with_interval(value, low, high)
    if value is None:
        return shown
    return f"{shown} times" if row["scale"] == "ratio" else f"{shown} {unit}".rstrip()


def _known(value: Any) -> float | None:
    return None if pd.isna(value) else float(value)


def write(study: Study, evidence: Evidence, provenance: pd.DataFrame, folder: Path) -> list[Path]:
    """Write `page.html`, `page.md`, `figures/` and every table into a folder."""
    html, markdown, pictures = pages(study, evidence, provenance)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    files = [folder / "page.html", folder / "page.md"]
    for file, text in zip(files, (html, markdown), strict=True):
        write_whole(file, text.encode())
    for picture in pictures:
        files += style.save_as(picture.file, folder / "figures" / picture.name)
    return [*files, *evidence.save(folder), *write_table(folder / "provenance", provenance)]


def write_index(name: str, studies: Sequence[Study], folder: Path) -> Path:
    """Write `index.html` and `index.md`, which link the pages of a collection's studies; return `index.html`."""
    done = [study for study in studies if (folder / study.name / "page.html").exists()]
    context = {
        "title": f"Studies: {name}",
        "question": f"{len(done)} studies, each with its own page.",
        "links": [
            {"page": f"{study.name}/page", "title": study.title, "question": study.file.study.question}
            for study in done
        ],
        **dict.fromkeys(("findings", "warnings", "sections"), ()),
    }
    for kind in ("html", "md"):
        write_whole(folder / f"index.{kind}", render(f"page.{kind}.jinja", context).encode())
    return folder / "index.html"


def provenance_of(manifest: dict[str, Any]) -> pd.DataFrame:
    """Make a table of where a sweep's runs come from, from its manifest.

    Raises:
        ValueError: the manifest is not as `deltaswarm sweep` writes it.
    """
    try:
        proofs = manifest["proofs"]
        rows = {
            "runs": f"{manifest['finished']} of {manifest['runs']}, by {manifest['means']}",
            "begun": manifest["started"],
            "wall time of all sessions": f"{manifest['wall_s'] / 60:.1f} min",
            "machine": f"{manifest['host']['cores']} cores, {manifest['host']['system']}",
            "versions": ", ".join(f"{name} {number}" for name, number in manifest["versions"].items() if number),
            "commit": manifest.get("commit") or "not known",
            "digest of the code": ", ".join(manifest["code"]),
            "digest of the sweep": manifest["digest"] or "not all runs are there",
            "repeated with real processes": f"{proofs['checked']} runs, {proofs['equal']} with the same digest",
        }
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"manifest.json is not as `deltaswarm sweep` writes it: {error!r}") from None
    return pd.DataFrame(list(rows.items()), columns=[*PROVENANCE])
