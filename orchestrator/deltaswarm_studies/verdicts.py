"""The parts of a page about verdicts: tables of claims, findings with their margins, counts of tests and verdicts."""

from collections.abc import Iterator
from datetime import timedelta
from typing import Any

import pandas as pd

from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.rendering import Table, decimals_for, number, p_value, table, with_interval
from deltaswarm_studies.sensitivity import tests_in
from deltaswarm_studies.settings import VERDICTS, FindingSettings
from deltaswarm_studies.stats import ALPHA, DIFFERENCE, RATIO
from deltaswarm_studies.study import Study
from deltaswarm_studies.survival import families_in
from deltaswarm_studies.wording import margins_of

ORDER = ("refuted", "differs", "undecided", "holds", "agrees", "no data")
"""Verdicts in the order of the table."""
PREDICTION = "Size of the rank correlation with "
CALIBRATED = "Calibrated: a reading was chosen so that these numbers agree, so their agreement is no evidence"


def supported(study: Study, evidence: Evidence) -> list[str]:
    """Return the findings that the results support, with the margins of the equivalences on which they rest."""
    pairs = zip(study.file.finding, evidence.findings["broken"], strict=True)
    return [_with_margins(study, finding) for finding, broken in pairs if not broken]


def _with_margins(study: Study, finding: FindingSettings) -> str:
    margins, text = margins_of(study, finding), " ".join(finding.text.split())
    return f"{text} (What does not differ is equivalent within {' or '.join(margins)}.)" if margins else text


def counts(claims: pd.DataFrame, *, is_calibrated: bool) -> dict[str, int]:
    """Count the verdicts of the claims by whose numbers a reading was chosen, or of the others."""
    verdicts = claims["verdict"][(claims["calibrated"] != "") == is_calibrated].tolist() if len(claims) else []
    return {verdict: verdicts.count(verdict) for verdict in VERDICTS["claim"] if verdict in verdicts}


def tests(evidence: Evidence) -> dict[str, int]:
    """Count the page's tests and the families in which they are corrected; without data there is no test."""
    tested = [rows[rows["n"] > 0] for rows in (evidence.contrasts, evidence.claims) if len(rows)]
    families = sum(len(rows.groupby("source" if "source" in rows else ["contrast", "metric"])) for rows in tested)
    of_events = families_in(evidence.survival)
    count, families = sum(map(len, tested)) + sum(of_events), families + len(of_events)
    if evidence.sensitivity and (correlations := tests_in(evidence.sensitivity.keys)):
        count, families = count + correlations, families + 1
    return {"tests": count, "families": families}


def claims_tables(study: Study, claims: pd.DataFrame, run_s: float | None) -> Iterator[Table]:
    """Make the table of claims, that of the calibrated ones, and what is known about why some do not hold.

    `run_s` is the wall time of a run [s].
    """
    rows = claims.sort_values("verdict", key=lambda verdicts: verdicts.map(ORDER.index), kind="stable")
    predictions = {claim.id for claim in study.file.claim if claim.kind == "predicts"}
    units = [(row["claim"] not in predictions) * study.metrics[row["metric"]].unit for _, row in rows.iterrows()]
    rows["here"] = [_found(row, unit) for (_, row), unit in zip(rows.iterrows(), units, strict=True)]
    rows["about"] = [
        f"{(row['claim'] in predictions) * PREDICTION}{study.metrics[row['metric']].title}: {_sides(study, row)}"
        for _, row in rows.iterrows()
    ]
    rows["p"] = ["" if pd.isna(p) else p_value(float(p)) for p in rows["p_holm"]]
    rows["decides"] = [_decides(row, run_s) for _, row in rows.iterrows()]
    rows["says"] = [
        f"{row['says']} (assumed: {row['assumes']})" if row["assumes"] else row["says"] for _, row in rows.iterrows()
    ]
    headings = {
        "text": "Claim",
        "verdict": "Verdict",
        "about": "Of what",
        "says": "Published",
        "criterion": "Criterion",
    }
    headings |= {"here": "Here", "n": "n", "p": "p (Holm)"} | ({"decides": "To decide"} if any(rows["decides"]) else {})
    headings |= {"source": "Source"}
    is_calibrated = rows["calibrated"] != ""
    if not is_calibrated.all():
        yield table(rows[~is_calibrated], headings)
    if is_calibrated.any():
        yield table(rows[is_calibrated], {**headings, "calibrated": "Chosen by it"}, CALIBRATED)
    surprising = claims[(claims["why"] != "") & ~claims["verdict"].isin(["holds", "agrees"])]
    if len(surprising):
        yield table(surprising[["text", "why"]], {"text": "Claim", "why": "What is known about why"})


def _sides(study: Study, row: Any) -> str:
    """Name the sides of a claim by their titles: of a ratio one over the other, of a difference one less the other."""
    titles = {label: study.variant_title(label) for label in study.levels}
    titles |= {name: metric.title for name, metric in study.metrics.items() if name not in titles}
    sides, less, published = str(row["about"]).partition(" less the")
    joined = " less " if row["scale"] == DIFFERENCE else " over "
    return joined.join(titles.get(side, side) for side in sides.split(" over ")) + less + published


def _found(row: Any, unit: str) -> str:
    """Show an estimate; of a comparison with a published number, both numbers with their sizes first."""
    found = estimate(row, unit)
    if pd.isna(row["ours"]):
        return found
    decimals = decimals_for([row["published"]])
    ours, theirs = number(row["ours"], decimals), number(row["published"], decimals)
    return f"{ours} (n = {row['n']}) against {theirs} (n = {row['published_n']:g}), difference {found}"


def _decides(row: Any, run_s: float | None) -> str:
    """Say how many replicates would decide an undecided comparison, and how long those that are missing take."""
    needed, of_both = known(row["needed"]), known(row["needed_of_both"])
    if row["verdict"] != "undecided" or pd.isna(row["ours"]) or row["p_holm"] <= ALPHA:  # else undone by a ceiling
        return ""
    if needed is None:
        both = f"; {of_both:.0f} on both sides" if of_both else ""
        return f"no number of ours alone, since the published number is too uncertain{both}"
    more = int(needed) - row["n"]
    time = "" if run_s is None else f", in about {timedelta(seconds=round(more * run_s))}"
    return f"{needed:.0f} replicates ({more} more{time})"


def estimate(row: Any, unit: str) -> str:
    value, low, high, error = (known(row[name]) for name in ("estimate", "low", "high", "mcse"))
    unit = "" if value is None else "times" if row["scale"] == RATIO else unit
    return f"{with_interval(value, low, high, error)} {unit}".rstrip()


def known(value: Any) -> float | None:
    """Return a number of a table; None where it is missing."""
    return None if pd.isna(value) else float(value)


def leave_one_out(rows: pd.DataFrame, text: str) -> Table:
    """Show a fit's sums without one published number at a time: how far the choice hangs on that number."""
    sums = rows.pivot(index="within", columns="target", values="without")
    sums = sums.loc[rows["within"].unique(), rows["target"].unique()]
    closest = sums.idxmin()
    kept = int((closest == sums.index[0]).sum())
    shown = sums.map(lambda value: number(value, 2))
    for target, combination in zip(sums.columns, closest, strict=True):
        shown[target] = shown[target].where(shown.index != combination, shown[target] + " (closest)")
    title = f"{text}: sums of squares without one number; {kept} of {len(closest)} leave the same combination closest"
    headings = {"within": "Combination"} | {str(name): f"without {name}" for name in sums.columns}
    return table(shown.reset_index(), headings, title)
