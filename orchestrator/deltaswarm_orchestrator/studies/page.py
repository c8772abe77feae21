"""Build a study's page: its tables and figures, in the order in which a reader asks."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from deltaswarm_orchestrator.report import words
from deltaswarm_orchestrator.report.page import Picture, Table, render, table
from deltaswarm_orchestrator.report.plots import style
from deltaswarm_orchestrator.report.plots.swarm import swarm
from deltaswarm_orchestrator.stats import RATIO
from deltaswarm_orchestrator.studies import charts, planes
from deltaswarm_orchestrator.studies.evidence import Evidence
from deltaswarm_orchestrator.studies.fits import grid_named
from deltaswarm_orchestrator.studies.metrics import PER_EVENT
from deltaswarm_orchestrator.studies.origin import PROVENANCE, since_the_runs
from deltaswarm_orchestrator.studies.settings import (
    CLAIM_VERDICTS,
    HOLDS,
    NO_DATA,
    REFUTED,
    UNDECIDED,
    FigureSettings,
)
from deltaswarm_orchestrator.studies.snapshot import snapshot
from deltaswarm_orchestrator.studies.study import Study
from deltaswarm_orchestrator.sweeps.table import write_table
from deltaswarm_wire.files import write_whole

CHARTS: Mapping[str, Callable[[FigureSettings, Study, pd.DataFrame], Figure]] = {
    "boxes": charts.boxes,
    "levels": charts.levels,
    "time": charts.time,
    "plane": planes.plane,
    "frontier": planes.frontier,
}
"""The drawing function of each kind of figure in a study file; `time` takes courses, the others take runs."""


@dataclass(frozen=True)
class Section:
    """A heading with its tables and pictures."""

    heading: str
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)


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
        "facts": {
            "verdicts": _counts(evidence.claims),
            "arrivals": evidence.arrivals,
            "horizons_s": sorted({variant.scenario.metrics.horizon_s for variant in study.sweep.variants}),
            "per_event": [study.metrics[name].title for name in PER_EVENT if name in set(evidence.estimates["metric"])],
        },
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
    return CHARTS[figure.kind](replace(figure, lines=_lines(figure, evidence.runs)), study, rows)


def _lines(figure: FigureSettings, runs: pd.DataFrame) -> dict[str, float]:
    """Return the height of each line: a number, or the median of a variant; no line where that has no values."""
    medians = runs.groupby("variant")[figure.metric].median() if figure.metric in runs else pd.Series(dtype=float)
    found = {name: medians.get(value) if isinstance(value, str) else value for name, value in figure.lines.items()}
    return {name: float(value) for name, value in found.items() if value is not None and not pd.isna(value)}


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
    if len(evidence.fits):
        yield Section("Closest to what is published", list(_fits(study, evidence.fits)))
    if len(evidence.grids):
        yield Section("Medians", list(_grids(study, evidence.grids)))
    if len(evidence.recovery):
        yield Section("Recovery", [_recovered(study, evidence.recovery)])
    yield Section("Estimates", [_estimates(study, evidence)])
    origin = pd.concat([provenance, since_the_runs(study, provenance)], ignore_index=True)
    yield Section("Where this comes from", [table(origin, PROVENANCE)])


def _counts(claims: pd.DataFrame) -> dict[str, int]:
    """Count the claims with each verdict."""
    found = claims["verdict"].tolist() if len(claims) else []
    return {verdict: found.count(verdict) for verdict in CLAIM_VERDICTS}


def _claims(study: Study, claims: pd.DataFrame) -> Table:
    order = {REFUTED: 0, UNDECIDED: 1, HOLDS: 2, NO_DATA: 3}
    rows = claims.sort_values("verdict", key=lambda verdicts: verdicts.map(order), kind="stable").copy()
    units = {name: metric.unit for name, metric in study.metrics.items()}
    rows["found"] = [_estimate(row, units[row["metric"]]) for _, row in rows.iterrows()]
    rows["p"] = ["" if pd.isna(value) else words.p_value(float(value)) for value in rows["p_holm"]]
    headings = {"text": "Claim", "verdict": "Verdict", "says": "Published", "criterion": "Criterion", "found": "Here"}
    return table(rows, {**headings, "n": "n", "p": "p (Holm)", "source": "Source"})


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
        title = f"{texts[str(name)] or name}: {study.metrics[str(metric)].title.lower()} ({_how(rows.iloc[0])})"
        yield table(shown, {**headings, "n": "n", "found": "Estimate", "p": "p (Holm)", "verdict": "Verdict"}, title)


def _how(row: Any) -> str:
    """Say how many comparisons a family has, and on which scale they are."""
    if row["scale"] == RATIO:
        return f"{row['family']} tests of ratios"
    return f"{row['family']} tests of differences, since values are 0 or below; a margin is a ratio and not tested"


def _fits(study: Study, fits: pd.DataFrame) -> Iterator[Table]:
    for text, rows in fits.groupby("fit", sort=False):
        rows = rows.assign(target=[f"{row['level']}: {row['metric']}" for _, row in rows.iterrows()])
        order = rows["within"].unique()
        wide = rows.pivot(index="within", columns="target", values="distance").loc[order, rows["target"].unique()]
        shown = wide.map(lambda value: words.number(value, 2)).reset_index()
        first = rows.groupby("within", sort=False).first().loc[order]
        shown["sum"] = [words.number(value, 2) for value in first["sum"]]
        shown["closest"] = [words.number(100 * value, 0) for value in first["closest"]]
        headings = {name: f"{name} [IQR]" for name in wide.columns}
        tail = {"sum": "Sum of squares", "closest": "Closest in [% of resamples]"}
        yield table(shown, {"within": "Combination", **headings, **tail}, str(text))


def _grids(study: Study, grids: pd.DataFrame) -> Iterator[Table]:
    for text, rows in grids.groupby("grid", sort=False):
        settings = grid_named(study, str(text))
        many = {heading for heading, levels in settings.columns.items() if len(levels) > 1}
        found = [
            words.number(row["median"], 1) + (f" ({row['level']})" if row["column"] in many else "")
            for _, row in rows.iterrows()
        ]
        wide = rows.assign(found=found).pivot(index="row", columns="column", values="found")
        wide = wide.loc[rows["row"].unique(), rows["column"].unique()].fillna("").reset_index()
        headings = {"row": study.factor_title(settings.rows), **{name: name for name in wide.columns[1:]}}
        yield table(wide, headings, f"{text}: {study.metrics[settings.metric].label}")


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
    replicates = evidence.runs.groupby("variant")["replicate"].nunique()
    rows["found"] = [
        words.with_interval(_known(row["median"]), _known(row["low"]), _known(row["high"]))
        + (f" (n = {row['n']})" if 0 < row["n"] < replicates[row["variant"]] else "")
        for _, row in rows.iterrows()
    ]
    wide = rows.pivot(index="variant", columns="metric", values="found").loc[rows["variant"].unique()].reset_index()
    wide["n"] = replicates.loc[wide["variant"]].to_numpy()
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
        "title": "Studies" if name == "all" else f"Studies: {name}",
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
