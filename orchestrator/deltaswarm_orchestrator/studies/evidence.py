"""Turn runs into verdicts: from a row per run to a row per estimate, contrast, claim and finding."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t

from deltaswarm_orchestrator.stats import ALPHA, RATIO, contrast, describe, holm
from deltaswarm_orchestrator.studies.metrics import ID, WAITING, WAITING_ALL, is_over_time, values_of, windows_of
from deltaswarm_orchestrator.studies.study import (
    ALIKE,
    HIGHER,
    HOLDS,
    LOWER,
    REFUTED,
    UNCLEAR,
    UNDECIDED,
    ClaimSettings,
    ContrastSettings,
    Study,
)

Row = dict[str, Any]
INTERACTION = " against "


def runs_of(study: Study, table: pd.DataFrame, series: pd.DataFrame) -> pd.DataFrame:
    """Make a row per run: columns that identify it, the level of each factor, every metric that the study uses.

    Raises:
        ValueError: If the tables lack a column that a metric needs.
    """
    runs = table[ID].copy()
    for factor, levels in _levels(study).items():
        runs[factor] = runs["variant"].map(levels)
    for name in used_metrics(study):
        runs[name] = values_of(study.metrics[name], table, series, study.step_s).to_numpy()
    return runs


def used_metrics(study: Study) -> list[str]:
    """List every metric that the study names.

    Add the other waiting metric if only one is named, to see whether both agree; not if the study takes them over a
    part of the run only.
    """
    file = study.file
    names = [*file.study.metrics, *(name for one in file.contrast for name in one.metrics)]
    names += [claim.metric for claim in file.claim]
    for figure in file.figure:
        names += [figure.metric] if figure.kind in ("boxes", "levels", "plane") else []
        names += [figure.x] if figure.kind == "plane" else []
    if {WAITING, WAITING_ALL} & set(names) and not is_over_time([study.metrics[WAITING_ALL]]):
        names += [WAITING, WAITING_ALL]
    return list(dict.fromkeys(names))


def _levels(study: Study) -> dict[str, dict[str, str]]:
    """Map each factor to its level in each variant."""
    places = list(itertools.product(*study.factors.values()))
    labels = [variant.label for variant in study.sweep.variants]
    return {
        factor: {label: place[index] for label, place in zip(labels, places, strict=True)}
        for index, factor in enumerate(study.factors)
    }


def windows_with_levels(study: Study, series: pd.DataFrame) -> pd.DataFrame:
    """Make a row per run and time window, with each factor's level and every built-in metric that has a series."""
    windows = windows_of(series, study.file.study.window_s, study.step_s)
    return windows.assign(**{factor: windows["variant"].map(levels) for factor, levels in _levels(study).items()})


def courses_of(study: Study, windows: pd.DataFrame) -> pd.DataFrame:
    """Make a row per variant, window and metric drawn over time: the mean and its 95 % t-interval."""
    rows = []
    for name in dict.fromkeys(figure.metric for figure in study.file.figure if figure.kind == "time"):
        found = windows.groupby(["variant", *study.factors, "time_s"], sort=False)[name].agg(["count", "mean", "sem"])
        half = found["sem"] * t.ppf(1 - ALPHA / 2, np.maximum(found["count"] - 1, 1))
        found = found.assign(metric=name, low=found["mean"] - half, high=found["mean"] + half)
        rows.append(found.drop(columns="sem").rename(columns={"count": "n"}).reset_index())
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame()


def estimates_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per variant and metric: median with interval, and quartiles."""
    rows: list[Row] = []
    metrics = used_metrics(study)
    for variant, own in runs.groupby("variant", sort=False):
        head = {"variant": variant, **{factor: own[factor].iloc[0] for factor in study.factors}}
        rows += [{**head, "metric": name, **asdict(describe(own[name]))} for name in metrics]
    return pd.DataFrame(rows)


def contrasts_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per comparison. Each pair of contrast and metric is one family for Holm's correction.

    `level` is compared with `reference` within the cell `within`; `verdict` says whether it is higher, lower, alike
    (within the margin) or unclear.
    """
    rows: list[Row] = []
    for settings in study.file.contrast:
        for metric in study.metrics_of(settings):
            rows += _corrected(list(_compared(study, settings, metric, runs)))
    return pd.DataFrame(rows)


def _compared(study: Study, settings: ContrastSettings, metric: str, runs: pd.DataFrame) -> Iterator[Row]:
    levels = study.factors[settings.factor]
    pairs = settings.pairs or [(level, settings.reference) for level in levels if level != settings.reference]
    margin = settings.margin or None
    for level, reference in pairs:
        for cell in cells(study, [settings.factor, *([settings.across] if settings.across else [])]):
            for within, a, b in _sides(study, settings, metric, runs, cell, level, reference):
                if not a:  # these variants were not run
                    continue
                yield {
                    "contrast": settings.id,
                    "metric": metric,
                    "level": level,
                    "reference": reference,
                    "within": within,
                    **asdict(contrast(a, b, margin=margin)),
                    "margin": settings.margin,
                }


def _sides(
    study: Study,
    settings: ContrastSettings,
    metric: str,
    runs: pd.DataFrame,
    cell: Mapping[str, str],
    level: str,
    reference: str,
) -> Iterator[tuple[str, Sequence[float], Sequence[float]]]:
    """Yield the paired samples of a comparison with the name of its cell; for an interaction, samples are changes."""

    def of(where: Mapping[str, str]) -> pd.Series:
        chosen = runs[np.logical_and.reduce([runs[factor] == value for factor, value in where.items()])]
        return chosen.set_index("replicate")[metric]

    def paired(where: Mapping[str, str]) -> tuple[pd.Series, pd.Series]:
        return _by_replicate(of({**where, settings.factor: level}), of({**where, settings.factor: reference}))

    if not settings.across:
        a, b = paired(cell)
        yield ", ".join(cell.values()), a.tolist(), b.tolist()
        return
    for one, other in settings.across_pairs:
        changes = []
        for value in (one, other):
            a, b = paired({**cell, settings.across: value})
            is_ratio = bool(((a > 0) & (b > 0)).all())
            changes.append(a / b if is_ratio else a - b)
        a, b = _by_replicate(*changes)
        yield ", ".join([*cell.values(), f"{one}{INTERACTION}{other}"]), a.tolist(), b.tolist()


def _by_replicate(a: pd.Series, b: pd.Series) -> tuple[pd.Series, pd.Series]:
    """Restrict two samples, indexed by replicate, to the replicates that both have."""
    shared = a.index.intersection(b.index)
    return a.loc[shared], b.loc[shared]


def cells(study: Study, without: Sequence[str]) -> list[dict[str, str]]:
    """List every combination of levels of all factors except `without`."""
    others = {factor: levels for factor, levels in study.factors.items() if factor not in without}
    return [dict(zip(others, place, strict=True)) for place in itertools.product(*others.values())]


def _corrected(rows: list[Row]) -> list[Row]:
    adjusted = holm([row["p"] for row in rows])
    alike = holm([row["p_alike"] if row["p_alike"] is not None else 1.0 for row in rows])
    for row, p, p_alike in zip(rows, adjusted, alike, strict=True):
        row |= {"p_holm": p, "p_alike_holm": None if row["p_alike"] is None else p_alike, "family": len(rows)}
        row["verdict"] = _direction(row)
    return rows


def _direction(row: Row) -> str:
    if row["p_alike_holm"] is not None and row["p_alike_holm"] < ALPHA:
        return ALIKE
    if row["p_holm"] >= ALPHA or row["estimate"] is None:
        return UNCLEAR
    return HIGHER if _sign(row) > 0 else LOWER


def claims_of(study: Study, runs: pd.DataFrame) -> pd.DataFrame:
    """Make a row per claim, with its verdict. Holm's correction is over the claims of the same source.

    - holds: the claim is significant, or the interval of a value lies within the tolerance;
    - refuted: the opposite is significant, or the interval of a value lies entirely outside the tolerance;
    - undecided: neither.
    """
    rows = [_judged(claim, runs) for claim in study.file.claim]
    for source in dict.fromkeys(row["source"] for row in rows):
        tested = [row for row in rows if row["source"] == source and not (row["p"] is row["p_opposite"] is None)]
        for name, verdict in (("p", HOLDS), ("p_opposite", REFUTED)):
            adjusted = holm([1.0 if row[name] is None else row[name] for row in tested])
            for row, p in zip(tested, adjusted, strict=True):
                row |= {f"{name}_holm": None if row[name] is None else p, "family": len(tested)}
                row["verdict"] = verdict if p < ALPHA else row["verdict"]
    return pd.DataFrame(rows)


def _judged(claim: ClaimSettings, runs: pd.DataFrame) -> Row:
    head = {"claim": claim.id, "text": claim.text, "source": claim.source, "says": claim.says}
    tail = {"expect": claim.expect, "why": claim.why}
    row: Row = {**head, "metric": claim.metric, "p": None, "p_holm": None, "p_opposite": None, "p_opposite_holm": None}
    row |= {"verdict": UNDECIDED, "scale": "", "effect": None}

    def of(variant: str) -> pd.Series:
        return runs[runs["variant"] == variant].set_index("replicate")[claim.metric]

    if claim.kind == "value":
        described = describe(of(claim.of))
        low, high = claim.within
        if described.low is not None and described.high is not None:
            if low <= described.low and described.high <= high:
                row["verdict"] = HOLDS
            elif described.high < low or high < described.low:
                row["verdict"] = REFUTED
        found = {"n": described.n, "estimate": described.median, "low": described.low, "high": described.high}
        return row | found | {"criterion": f"{low:g} to {high:g}"} | tail
    a, b = (of(claim.more), of(claim.less)) if claim.kind == "order" else (of(claim.a), of(claim.b))
    first, second = (sample.tolist() for sample in _by_replicate(a, b))
    if claim.kind == "alike":
        shown = contrast(first, second, margin=claim.margin)
        row |= {"p": shown.p_alike, "p_opposite": shown.p_beyond, "criterion": f"within {claim.margin:g} times"}
    else:
        shown = contrast(first, second)
        tested = contrast(first, [claim.at_least * value for value in second])
        row |= {"p" if _sign(asdict(tested)) > 0 else "p_opposite": tested.p}
        row |= {"criterion": f"at least {claim.at_least:g} times" if claim.at_least != 1 else "more"}
    return row | {name: getattr(shown, name) for name in ("scale", "n", "estimate", "low", "high", "effect")} | tail


def findings_of(study: Study, claims: pd.DataFrame, contrasts: pd.DataFrame) -> pd.DataFrame:
    """Make a row per finding: the sentence, and the results that no longer support it (empty if all do)."""
    rows = []
    for finding in study.file.finding:
        broken = [told for result in finding.because if (told := _broken(result, claims, contrasts))]
        rows.append({"text": finding.text, "broken": "; ".join(broken)})
    return pd.DataFrame(rows, columns=["text", "broken"])


def _broken(result: Mapping[str, Any], claims: pd.DataFrame, contrasts: pd.DataFrame) -> str:
    """Say why a result does not support a finding; empty if it does."""
    rows = claims if "claim" in result else contrasts
    for name, value in result.items():
        if name != "is":
            rows = rows[rows[name] == value] if name in rows else rows.iloc[:0]
    named = ", ".join(f"{name} {value!r}" for name, value in result.items() if name != "is")
    if rows.empty:
        return f"there is no result with {named}"
    wrong = rows[rows["verdict"] != result["is"]]
    return f"{named} is {wrong['verdict'].iloc[0]}, not {result['is']}" if len(wrong) else ""


def disagreements(study: Study, runs: pd.DataFrame) -> list[str]:
    """List comparisons of waiting whose direction reverses when events that were never sensed are counted too.

    A swarm that never finds the difficult events would look fast by the events that it did find.
    """
    found: list[str] = []
    if not {WAITING, WAITING_ALL} <= set(runs):
        return found
    for settings in study.file.contrast:
        used = {WAITING, WAITING_ALL} & set(study.metrics_of(settings))
        if settings.across or not used:
            continue
        by = {name: list(_compared(study, settings, name, runs)) for name in (WAITING, WAITING_ALL)}
        for row, other in zip(by[WAITING], by[WAITING_ALL], strict=True):
            signs = {_sign(one) for one in (row, other)}
            if signs == {-1, 1} and min(row["p"], other["p"]) < ALPHA:
                found.append(
                    f"{row['level']} against {row['reference']} ({row['within']}): waiting by sensed events and by all "
                    "events rank them in opposite order"
                )
    return found


def _sign(row: Row) -> int:
    """Return the direction of the estimate: 1 is higher, -1 is lower, 0 is neither."""
    return 0 if row["estimate"] is None else int(np.sign(row["estimate"] - (1 if row["scale"] == RATIO else 0)))
