"""Build a study's page: its tables and figures, in the order in which a reader asks."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.sweeps.table import write_table
from deltaswarm_studies import event_page, sensitivity_page, style, verdicts
from deltaswarm_studies import events as event_tables
from deltaswarm_studies.ceilings import shown
from deltaswarm_studies.crate import write_crate
from deltaswarm_studies.design import design
from deltaswarm_studies.drawing import draw
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.metrics import PER_EVENT
from deltaswarm_studies.origin import PROVENANCE, WITH_THE_RUNS, facts_of, run_s, seal_tables, since_the_runs
from deltaswarm_studies.protocol import Protocol, protocol_of
from deltaswarm_studies.protocol_page import Record
from deltaswarm_studies.rendering import CaptionedFigure, Table, number, p_value, render, table, with_interval
from deltaswarm_studies.stats import RATIO
from deltaswarm_studies.study import Study
from deltaswarm_wire.files import write_whole

DISTANCES, SUMS = ["distance", "mcse"], ["sum", "sum_mcse"]
"""Columns of fits: an estimate and its standard error."""


def pages(
    study: Study, evidence: Evidence, provenance: pd.DataFrame, sealed: str = "", protocol: Protocol | None = None
) -> tuple[str, str, list[CaptionedFigure]]:
    """Make the page as HTML and as Markdown, and its pictures.

    `sealed`: since when the tables are; empty: not. `protocol`: by default, there is none. What cannot be drawn becomes
    a warning of the page and of the evidence: a page without a figure is better than none.
    """
    protocol = protocol or Protocol(study)
    record = Record(protocol, evidence)
    pictures, evidence.undrawn = [], []
    for figure in study.file.figure:
        try:
            drawing = draw(figure, study, evidence)
        except ValueError as error:
            evidence.undrawn.append(f"The figure {figure.name!r} is missing: {error}.")
            continue
        caption = " ".join(" ".join([figure.caption, *drawing.notes]).split())
        pictures.append(CaptionedFigure(figure.name.replace(" ", "-"), drawing.figure, caption))
    sections = list(_sections(study, evidence, pictures, provenance, sealed, record))
    context: dict[str, Any] = {
        "title": study.title,
        "status": record.lead,
        "question": " ".join(study.file.study.question.split()),
        "design": design(study),
        "findings": evidence.findings,
        "warnings": [*protocol.problems, *evidence.warnings],
        "replaced": list(record.replaced),
        "sections": sections,
        "facts": {
            "verdicts": verdicts.counts(evidence.claims, is_calibrated=False),
            "calibrated": verdicts.counts(evidence.claims, is_calibrated=True),
            "tests": verdicts.tests(evidence.tables),
            "arrivals": evidence.arrivals,
            "averaged": sorted({study.factor_title(over) for over in study.averaged_over}),
            "events": event_tables.kept(study, evidence.events, evidence.runs),
            "sensitivity": sensitivity_page.facts(study, evidence.sensitivity) if evidence.sensitivity else {},
            "horizons_s": sorted({scenario.metrics.horizon_s for scenario in study.sweep.scenarios}),
            "per_event": [study.metrics[name].title for name in PER_EVENT if name in set(evidence.estimates["metric"])],
        },
        "figures": "figures",
    }
    pictures = [picture for section in sections for picture in section["pictures"]]
    return render("page.html.jinja", context), render("page.md.jinja", context), pictures


def _sections(
    study: Study,
    evidence: Evidence,
    pictures: list[CaptionedFigure],
    provenance: pd.DataFrame,
    sealed: str,
    record: Record,
) -> Iterator[dict[str, Any]]:
    parts: tuple[tuple[str, pd.DataFrame, Callable[..., Iterator[Table]]], ...] = (
        ("Contrasts", evidence.contrasts, _contrasts),
        ("Closest to what is published", evidence.fits, _fits),
        ("Medians", evidence.grids, _grids),
        ("Recovery", evidence.recovery, _recovered),
        ("Times of events", evidence.survival, event_page.survival_tables),
        ("Times over space", evidence.rings, event_page.ring_tables),
    )
    if len(evidence.claims):
        tables = [*verdicts.claims_tables(study, evidence.claims, run_s(provenance))]
        yield {"heading": "Verdicts", "tables": tables, "pictures": []}
    if evidence.sensitivity:
        yield sensitivity_page.section(study, evidence.sensitivity)
    yield {"heading": "Protocol", "tables": list(record.tables), "pictures": []}
    if pictures:
        yield {"heading": "Figures", "tables": [], "pictures": pictures}
    for heading, rows, made in parts:
        if len(rows):
            yield {"heading": heading, "tables": list(made(study, rows)), "pictures": []}
    yield {"heading": "Estimates", "tables": [_estimates(study, evidence)], "pictures": []}
    if replaced := record.replaced_contrasts:
        yield {"heading": "Contrasts of what this study replaces", "tables": replaced, "pictures": []}
    if record.amendments:
        yield {"heading": "Amendments", "tables": record.amendments, "pictures": []}
    origin = pd.concat([provenance, since_the_runs(study, provenance, sealed)], ignore_index=True)
    yield {"heading": "Where this comes from", "tables": [table(origin, PROVENANCE)], "pictures": []}


def _contrasts(study: Study, contrasts: pd.DataFrame) -> Iterator[Table]:
    asked = {settings.id: settings for settings in study.file.contrast}
    for (name, metric), rows in contrasts.groupby(["contrast", "metric"], sort=False):
        about, first, contrast = study.metrics[str(metric)], rows.iloc[0], asked[str(name)]
        within = {row.within: row.within_title for row in study.comparisons(contrast)}
        rows = rows.assign(
            level=[study.level_name(contrast.factor, level) for level in rows["level"]],
            reference=[study.level_name(contrast.factor, level) for level in rows["reference"]],
            within=rows["within"].map(within),
            shown=[verdicts.estimate(row, about.unit) for _, row in rows.iterrows()],
            p=[p_value(float(p)) for p in rows["p_holm"]],
            decides=[verdicts.decides(row, None) for _, row in rows.iterrows()],
        )
        heading = study.factor_title(contrast.factor)
        headings = {
            "level": heading[:1].upper() + heading[1:],
            "reference": "Against",
            **({"within": "Within"} if any(rows["within"]) else {}),
        }
        scale = "ratios"
        if first["scale"] != RATIO:
            scale = "differences, since values are 0 or below"
        tests = f"{first['family']} test{'s' if first['family'] > 1 else ''}"
        title = f"{contrast.text or name}: {about.title.lower()} ({tests} of {scale})"
        headings |= {"n": "n", "shown": "Estimate", "p": "p (Holm)", "verdict": "Verdict"}
        yield table(rows, headings | ({"decides": "To decide"} if any(rows["decides"]) else {}), title)


def _fits(study: Study, fits: pd.DataFrame) -> Iterator[Table]:
    for text, rows in fits.groupby("fit", sort=False):
        fit = next(fit for fit in study.file.fit if fit.text == text)
        cells = study.cells([fit.factor])
        titles = {", ".join(cell.values()): study.cell_title(cell) for cell in cells}
        targets = [
            f"{study.level_title(fit.factor, row['level'])}: {study.metrics[row['metric']].title}"
            for _, row in rows.iterrows()
        ]
        rows = rows.assign(target=targets, within=rows["within"].map(titles))
        order = rows["within"].unique()
        rows["shown"] = [f"{number(value, 2)} ({number(error, 2)})" for value, error in rows[DISTANCES].to_numpy()]
        wide = rows.pivot(index="within", columns="target", values="shown").loc[order, rows["target"].unique()]
        shown = wide.reset_index()
        first = rows.groupby("within", sort=False).first().loc[order]
        shown["sum"] = [f"{number(value, 2)} ({number(error, 2)})" for value, error in first[SUMS].to_numpy()]
        shown["closest"] = [number(100 * value, 0) for value in first["closest"]]
        headings = {name: f"{name} [IQR]" for name in wide.columns}
        if len(order) == 1:  # there is nothing to be closer than
            yield table(shown, headings, str(text))
            continue
        tail = {"sum": "Sum of squares", "closest": "Closest in [% of resamples]"}
        yield table(shown, {"within": "Combination", **headings, **tail}, str(text))
        yield verdicts.leave_one_out(rows, str(text))


def _grids(study: Study, grids: pd.DataFrame) -> Iterator[Table]:
    for text, rows in grids.groupby("grid", sort=False):
        settings = next(grid for grid in study.file.grid if grid.text == text)
        many = {heading for heading, levels in settings.columns.items() if len(levels) > 1}
        cells = [
            with_interval(row["median"], None, None, verdicts.known(row["mcse"]))
            + (f", {study.level_name(settings.factor, row['level'])}" if row["column"] in many else "")
            for _, row in rows.iterrows()
        ]
        wide = rows.assign(cell=cells).pivot(index="row", columns="column", values="cell")
        wide = wide.loc[rows["row"].unique(), rows["column"].unique()].fillna("").reset_index()
        wide["row"] = [study.level_name(settings.rows, level) for level in wide["row"]]
        headings = {"row": study.factor_title(settings.rows), **{name: name for name in wide.columns[1:]}}
        yield table(wide, headings, f"{text}: {study.metrics[settings.metric].label}")


def _recovered(study: Study, recovery: pd.DataFrame) -> Iterator[Table]:
    rows = recovery.copy()
    asked = {(one.metric, one.level, one.reference): one.factor for one in study.file.recovery}
    factors = [asked[place] for place in zip(rows["metric"], rows["level"], rows["reference"], strict=True)]
    within = {
        ", ".join(cell.values()): study.cell_title(cell) for factor in asked.values() for cell in study.cells([factor])
    }
    rows["within"] = rows["within"].map(within)
    for name in ("level", "reference"):
        rows[name] = [study.level_title(*place) for place in zip(factors, rows[name], strict=True)]
    rows["metric"] = [study.metrics[name].title for name in rows["metric"]]
    for name in ("back_s", "low_s", "high_s"):
        rows[name] = ["not by the end" if value == float("inf") else number(value, 0) for value in rows[name]]
    if "mcse_s" not in rows:  # of a page whose recovery was computed by an earlier version
        rows["mcse_s"] = math.nan
    rows["interval"] = [f"{row['low_s']} to {row['high_s']}" for _, row in rows.iterrows()]
    headings = {"metric": "Metric", "level": "Level", "reference": "Against", "within": "Within", "n": "n"}
    yield table(
        rows, {**headings, "back_s": "Back after [s]", "mcse_s": "Standard error [s]", "interval": "95 % interval [s]"}
    )


def _estimates(study: Study, evidence: Evidence) -> Table:
    rows = evidence.estimates.copy()
    metrics = list(dict.fromkeys(rows["metric"]))
    replicates = evidence.means.groupby("variant")["replicate"].nunique()
    rows["cell"] = [
        shown(
            with_interval(*(verdicts.known(row[name]) for name in ("median", "low", "high", "mcse"))),
            *(verdicts.known(row["median"]), study.metrics[row["metric"]], study, row["variant"]),
        )
        + (f" (n = {row['n']})" if 0 < row["n"] < replicates[row["variant"]] else "")
        for _, row in rows.iterrows()
    ]
    wide = rows.pivot(index="variant", columns="metric", values="cell").loc[rows["variant"].unique()].reset_index()
    wide["n"] = replicates.loc[wide["variant"]].to_numpy()
    wide["variant"] = [study.variant_title(name) for name in wide["variant"]]
    return table(wide, {"variant": "Variant", "n": "n", **{name: study.metrics[name].label for name in metrics}})


def write(
    study: Study, evidence: Evidence, provenance: pd.DataFrame, folder: Path, sealed: str = WITH_THE_RUNS
) -> list[Path]:
    """Write `page.html`, `page.md`, `figures/` and every table into a folder, and seal the tables.

    `sealed` says since when they are sealed; empty: leave them without a seal, since nobody knows what they were.
    """
    protocol = protocol_of(study, folder, provenance, evidence.runs, is_sealed=bool(sealed))
    html, markdown, pictures = pages(study, evidence, provenance, sealed, protocol)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    files = [folder / "page.html", folder / "page.md"]
    for file, text in zip(files, (html, markdown), strict=True):
        write_whole(file, text.encode())
    for picture in pictures:
        files += style.save_as(picture.file, folder / "figures" / picture.name)
    (folder / seal.RECORD).unlink(missing_ok=True)  # else a page that is cut off here would seem to be edited
    tables = [*evidence.save(folder), *write_table(folder / "provenance", provenance)]
    if sealed:
        seal_tables(study, provenance, folder, tables, sealed)
    return [*files, *tables, write_crate(study, folder, facts_of(provenance))]


def write_index(name: str, studies: Sequence[Study], folder: Path) -> Path:
    """Write `index.html` and `index.md`, which link the pages of a collection's studies; return `index.html`."""
    written = [study for study in studies if (folder / study.name / "page.html").exists()]
    context = {
        "title": "Studies" if name == "all" else f"Studies: {name}",
        "status": "",
        "question": verdicts.tests_of_pages(folder / study.name for study in written),
        "links": [
            {"page": f"{study.name}/page", "title": study.title, "question": study.file.study.question}
            for study in written
        ],
        **dict.fromkeys(("design", "findings", "warnings", "replaced", "sections"), ()),
    }
    for kind in ("html", "md"):
        write_whole(folder / f"index.{kind}", render(f"page.{kind}.jinja", context).encode())
    return folder / "index.html"
