"""The parts of a page about verdicts: tables of claims, findings with their margins, counts of tests and verdicts."""

from collections.abc import Iterable, Iterator, Mapping
from datetime import timedelta
from pathlib import Path
from typing import Any

import pandas as pd

from deltaswarm_studies.claim_settings import ANYWAY, DEPENDS, VERDICTS
from deltaswarm_studies.rendering import Table, decimals_for, number, p_value, table, with_interval
from deltaswarm_studies.sensitivity import tests_in
from deltaswarm_studies.stats import ALPHA, DIFFERENCE, RATIO
from deltaswarm_studies.study import Study
from deltaswarm_studies.survival import families_in
from deltaswarm_studies.welch import MAX_REPLICATES

ORDER = ("refuted", "differs", DEPENDS, "undecided", ANYWAY, "holds", "agrees", "no data")
"""Verdicts in the order of the table."""
UNITS = {"too few cells": "levels", "too few halves": "replicates that are compared"}
"""What a number of runs that would decide counts, if not replicates."""
PREDICTIONS = {
    "predicts": "Size of the rank correlation with ",
    "trend": "Rank correlation with the order of variants, ",
}
CALIBRATED = "Calibrated: a reading was chosen so that these numbers agree, so their agreement is no evidence"


def counts(claims: pd.DataFrame, *, is_calibrated: bool) -> dict[str, int]:
    """Count the verdicts of the claims by whose numbers a reading was chosen, or of the others."""
    verdicts = claims["verdict"][(claims["calibrated"] != "") == is_calibrated].tolist() if len(claims) else []
    return {verdict: verdicts.count(verdict) for verdict in VERDICTS if verdict in verdicts}


TESTED = ("contrasts", "claims", "survival", "keys")
"""Tables of tests."""


def tests(tables: Mapping[str, pd.DataFrame]) -> dict[str, int]:
    """Count the tests of a page's tables, and the families in which they are corrected; without data is no test."""
    tested = [rows[rows["n"] > 0] for name in TESTED[:2] if len(rows := tables.get(name, pd.DataFrame()))]
    keys = ["source" if "source" in rows else ["contrast", "metric"] for rows in tested]
    families = sum(len(rows.groupby(key, dropna=False)) for rows, key in zip(tested, keys, strict=True))
    of_events = families_in(tables.get("survival", pd.DataFrame()))
    count, families = sum(map(len, tested)) + sum(of_events), families + len(of_events)
    if "keys" in tables and (correlations := tests_in(tables["keys"])):
        count, families = count + correlations, families + 1
    return {"tests": count, "families": families}


def tests_of_pages(folders: Iterable[Path]) -> str:
    """Say how many tests the pages in these folders hold, by their tables."""
    files = [
        {name: folder / f"{name}.csv" for name in TESTED if (folder / f"{name}.csv").exists()} for folder in folders
    ]
    found = [tests({name: pd.read_csv(file) for name, file in one.items()}) for one in files]
    count, families = (sum(one[name] for one in found) for name in ("tests", "families"))
    return (
        f"{len(files)} pages hold {count:,} tests in {families:,} families. If nothing differed at all, at most "
        f"{ALPHA * families:.0f} families would be expected to show a difference (Holm's correction, 5 % each)."
    )


def claims_tables(study: Study, claims: pd.DataFrame, run_s: float | None) -> Iterator[Table]:
    """Make the table of claims, that of the calibrated ones, and what is known about why some do not hold.

    `run_s` is the wall time of a run [s].
    """
    rows = claims.sort_values("verdict", key=lambda verdicts: verdicts.map(ORDER.index), kind="stable")
    predictions = {claim.id for claim in study.file.claim if claim.kind in ("predicts", "trend")}
    kinds = {claim.id: claim.kind for claim in study.file.claim}
    units = [(row["claim"] not in predictions) * study.metrics[row["metric"]].unit for _, row in rows.iterrows()]
    rows["here"] = [_found(row, unit) for (_, row), unit in zip(rows.iterrows(), units, strict=True)]
    rows["about"] = [
        f"{PREDICTIONS.get(kinds[row['claim']], '')}{study.metrics[row['metric']].title}: {_sides(study, row)}"
        for _, row in rows.iterrows()
    ]
    rows["p"] = ["" if pd.isna(p) else p_value(float(p)) for p in rows["p_holm"]]
    rows["decides"] = [decides(row, run_s) for _, row in rows.iterrows()]
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
    if " over " not in sides:
        return f"{', '.join(titles.get(side, side) for side in sides.split(' to '))}{less}{published}"
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


def decides(row: Any, run_s: float | None) -> str:
    """Say how many replicates would decide an undecided comparison, and how long those that are missing take."""
    needed, of_both = known(row["needed"]), known(row.get("needed_of_both"))
    if not row["open"]:
        return ""
    if needed is None and ("ours" not in row or pd.isna(row["ours"])):
        return row["open"] if row["open"] == "cannot be closed" else f"{row['open']}: more than {MAX_REPLICATES:,}"
    if needed is None:
        both = f"; {of_both:.0f} on both sides" if of_both else ""
        return f"no number of ours alone, since the published number is too uncertain{both}"
    more = int(needed) - row["n"]
    if unit := UNITS.get(row["open"]):
        return f"{needed:.0f} {unit} ({more} more)"
    time = "" if run_s is None else f", in about {timedelta(seconds=round(more * run_s))}"
    only = ", for a difference only: no margin" if row["open"] == "no margin" else ""
    return f"{needed:.0f} replicates ({more} more{time}){only}"


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
