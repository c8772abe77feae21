"""Values at their ceiling: a time as long as the horizon says nothing but that it is no shorter.

What can be known from the scenario is refused before the runs. After the runs, a verdict stays only if it would be the
same for any longer times.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from deltaswarm_studies.event_checks import horizons_s, too_short
from deltaswarm_studies.metrics import StudyMetric, source_of
from deltaswarm_studies.settings import ClaimSettings
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import Problem

if TYPE_CHECKING:
    import pandas as pd

AT = 0.99
"""Share of the horizon from which on a value is at its ceiling: of a mean that near, nearly all times are cut off."""

NOT_WITHIN = {"alike": "unclear", "slightly higher": "higher", "slightly lower": "lower"}
"""What is left of a contrast's verdict without its margin."""


def ceiling_problems(study: Study) -> Iterator[Problem]:
    """Yield claims, contrasts, recoveries, fits and grids about times that no event can reach within the horizon."""
    for where, name, variants in judged(study):
        source = source_of(study.metrics[name])
        if not (source and source.moment):
            continue
        own = horizons_s(study, variants)
        given = " or ".join(f"{horizon_s:.15g}" for horizon_s in own)
        if reason := too_short(source.moment, study, variants):
            yield Problem("metrics.horizon_s", given, f"{reason} ({where}: {name!r})")
        elif len(own) > 1 and not study.sweep.points and where.startswith(("contrast", "claim")):
            allowed = (
                f"must be the same for {' and '.join(map(repr, variants))}, which are compared ({where}: {name!r})"
            )
            yield Problem("metrics.horizon_s", given, allowed)


def judged(study: Study) -> Iterator[tuple[str, str, Sequence[str]]]:
    """Yield each place at which a metric of some variants is judged: the place, the metric, the variants."""
    file, everything = study.file, list(study.levels)
    for i, contrast in enumerate(file.contrast):
        sides = list(dict.fromkeys(side for row in study.comparisons(contrast) for side in row.sides))
        yield from ((f"contrast[{i}]", name, side) for name in study.metrics_of(contrast) for side in sides)
    for i, claim in enumerate(file.claim):
        names = [claim.metric, *claim.predictors]
        yield from ((f"claim[{i}]", name, claim.variants or everything) for name in names)
    yield from ((f"recovery[{i}]", recovery.metric, everything) for i, recovery in enumerate(file.recovery))
    yield from ((f"grid[{i}]", grid.metric, everything) for i, grid in enumerate(file.grid))
    yield from ((f"fit[{i}]", target.metric, everything) for i, fit in enumerate(file.fit) for target in fit.targets)


def ceiling_s(metric: StudyMetric, study: Study, variant: str) -> float | None:
    """Return the horizon if it bounds a metric [s], else None; None also if it differs between points."""
    source, own = source_of(metric), horizons_s(study, [variant])
    return own[0] if source and source.is_restricted and len(own) == 1 else None


class AtCeiling(NamedTuple):
    """How many values of a variant's metric are at their ceiling."""

    reached: int
    n: int
    horizon_s: float

    @property
    def is_most(self) -> bool:
        """Whether more than half of the values are."""
        return 2 * self.reached > self.n


def at_ceiling(study: Study, runs: "pd.DataFrame") -> dict[tuple[str, str], AtCeiling]:
    """Return, by metric and variant, where most of the runs' values are at their ceiling."""
    found = {}
    for name in study.metrics:
        for variant, rows in runs.groupby("variant") if name in runs else ():
            horizon_s = ceiling_s(study.metrics[name], study, str(variant))
            if horizon_s is not None:
                values = rows[name].dropna()
                found[name, str(variant)] = AtCeiling(int((values >= AT * horizon_s).sum()), len(values), horizon_s)
    return {place: each for place, each in found.items() if each.is_most}


def undecided(
    study: Study, runs: "pd.DataFrame", contrasts: "pd.DataFrame", claims: "pd.DataFrame"
) -> tuple["pd.DataFrame", "pd.DataFrame", list[str]]:
    """Return contrasts and claims without the verdicts that longer times could change, and a line for each row.

    A verdict that stays is of an estimate that is only a bound.
    """
    found = at_ceiling(study, runs)
    lines: dict[str, None] = {}
    contrasts, claims = contrasts.copy(), claims.copy()
    for settings in study.file.contrast:
        for row in study.comparisons(settings):
            for name in study.metrics_of(settings):
                high, low = ([side[i] for side in row.sides if (name, side[i]) in found] for i in (0, 1))
                kept = _contrast_kept(bool(high), bool(low)) if len(row.sides) == 1 else ()
                own = {"contrast": settings.id, "metric": name, **row._asdict()}
                if high or low:
                    level, other = (study.level_title(settings.factor, name) for name in (row.level, row.reference))
                    what = f"the contrast {settings.text or settings.id!r} ({level} against {other})"
                    lines |= _undecide(study, contrasts, own, kept, "unclear", what, name, found, [*high, *low])
    for claim in study.file.claim:
        name = claim.metric
        of = [variant for variant in claim.variants or study.levels if (name, variant) in found]
        if of and (claim.variants or 2 * len(of) > len(study.levels)):
            what = f"the claim {claim.id!r}"
            kept = _claim_kept(claim, of, found[name, of[0]].horizon_s)
            lines |= _undecide(study, claims, {"claim": claim.id}, kept, "undecided", what, name, found, of)
    lines |= dict.fromkeys(_without_room(study, runs, contrasts, claims))
    return contrasts, claims, list(lines)


def _without_room(
    study: Study, runs: "pd.DataFrame", contrasts: "pd.DataFrame", claims: "pd.DataFrame"
) -> Iterator[str]:
    """Take back equivalences that the ceiling alone brings about, since no value could exceed the margin.

    Yield a line for each. Values of 147 s below a ceiling of 150 s are within 1.1 times of whatever is compared.
    """
    for settings in study.file.contrast if len(contrasts) else ():
        for row in study.comparisons(settings):
            for name in study.metrics_of(settings):
                is_row = _rows(contrasts, {"contrast": settings.id, "metric": name, **row._asdict()})
                is_row &= contrasts["verdict"].isin(NOT_WITHIN)
                why = _no_room(study, runs, name, [*itertools.chain(*row.sides)], settings.margin)
                if why and is_row.any():
                    contrasts.loc[is_row, "verdict"] = contrasts.loc[is_row, "verdict"].map(NOT_WITHIN)
                    level, other = (study.level_title(settings.factor, name) for name in (row.level, row.reference))
                    what = f"the contrast {settings.text or settings.id!r} ({level} against {other})"
                    yield f"Not shown to be alike: {what}, since {why}."
    for claim in study.file.claim:
        if claim.kind == "alike":
            is_row = _rows(claims, {"claim": claim.id}) & (claims["verdict"] == "holds")
            why = _no_room(study, runs, claim.metric, claim.variants, claim.margin)
            if why and is_row.any():
                claims.loc[is_row, "verdict"] = "undecided"
                yield f"Not decided: the claim {claim.id!r}, since {why}."


def _no_room(study: Study, runs: "pd.DataFrame", name: str, variants: Sequence[str], margin: float) -> str:
    """Say of which variant no other value could be `margin` times the median, because of the ceiling; "" if of none."""
    for variant in variants:
        horizon_s = ceiling_s(study.metrics[name], study, variant)
        if horizon_s is not None and name in runs:
            median = float(runs.loc[runs["variant"] == variant, name].median())
            if margin * median >= horizon_s:
                title, shown = study.metrics[name].title, study.variant_title(variant)
                return (
                    f"the horizon of {horizon_s:g} s leaves no room for {margin:g} times the median of {title!r} in "
                    f"{shown!r}, {median:.3g} s"
                )
    return ""


def _rows(table: "pd.DataFrame", own: Mapping[str, Any]) -> "pd.Series":
    """Return which rows have these values."""
    is_row = table["verdict"] != "no data"
    for column, value in own.items():
        is_row &= table[column] == value if column in table else True
    return is_row


def _contrast_kept(is_level: bool, is_reference: bool) -> tuple[str, ...]:
    """Return the verdict that stays, whichever longer times one side has; none if both are at their ceiling."""
    return () if is_level and is_reference else ("higher",) if is_level else ("lower",)


def _claim_kept(claim: ClaimSettings, of: Sequence[str], horizon_s: float) -> tuple[str, ...]:
    """Return the verdicts of a claim that stay, whichever longer times these variants have."""
    if len(of) > 1 or claim.kind == "predicts":
        return ()
    if claim.kind == "order":
        return ("holds",) if of == [claim.more] else ("refuted",)
    if claim.kind == "value":
        least, most = claim.region
        return ("refuted",) if most < horizon_s else ("holds",) if claim.above is not None and least < horizon_s else ()
    if claim.kind == "published":
        return ("differs",) if (claim.published or 0.0) < horizon_s else ()
    return ("refuted",)


def _undecide(
    study: Study,
    table: "pd.DataFrame",
    own: Mapping[str, Any],
    kept: Sequence[str],
    verdict: str,
    what: str,
    metric: str,
    found: Mapping[tuple[str, str], AtCeiling],
    variants: Sequence[str],
) -> dict[str, None]:
    """Replace the verdict of the row with these values, unless it stays; return the line that says what happened."""
    is_row = _rows(table, own)
    if not is_row.any():
        return {}
    is_kept = table.loc[is_row, "verdict"].iloc[0] in kept
    if not is_kept:
        table.loc[is_row, "verdict"] = verdict
    each = found[metric, variants[0]]
    title, variant = study.metrics[metric].title, study.variant_title(variants[0])
    share = f"{each.reached} of {each.n} values of {title!r} in {variant!r}"
    found_of = "Only a bound: the estimate of" if is_kept else "Not decided:"
    return {f"{found_of} {what}, since {share} are at their ceiling, the horizon of {each.horizon_s:g} s.": None}


def shown(text: str, value: float | None, metric: StudyMetric, study: Study, variant: str) -> str:
    """Return the text of a value, or that the value is at its ceiling."""
    horizon_s = ceiling_s(metric, study, variant)
    return f"> {horizon_s:g}" if horizon_s is not None and value is not None and value >= horizon_s else text
