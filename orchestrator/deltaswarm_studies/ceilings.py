"""Values at their ceiling: a time as long as the horizon says nothing but that it is no shorter.

What can be known from the scenario is refused before the runs. After the runs, a verdict stays only if it would be the
same for any longer times.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from deltaswarm_studies.claim_settings import ClaimSettings
from deltaswarm_studies.event_checks import horizons_s, too_short
from deltaswarm_studies.metrics import StudyMetric, source_of
from deltaswarm_studies.settings import ContrastSettings
from deltaswarm_studies.stats import RATIO
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


class _Judged(NamedTuple):
    """A row of the table of contrasts or of claims."""

    table: "pd.DataFrame"
    own: Mapping[str, Any]
    """The values by which the row is found."""
    what: str
    metric: str
    variants: Sequence[str]
    of: ContrastSettings | ClaimSettings

    @property
    def is_row(self) -> "pd.Series":
        """Which rows of the table have these values and a verdict."""
        is_row = self.table["verdict"] != "no data"
        for column, value in self.own.items():
            is_row &= self.table[column] == value if column in self.table else True
        return is_row


def _rows(study: Study, contrasts: "pd.DataFrame", claims: "pd.DataFrame") -> Iterator[_Judged]:
    for settings in study.file.contrast if len(contrasts) else ():
        for row in study.comparisons(settings):
            level, other = (study.level_title(settings.factor, name) for name in (row.level, row.reference))
            what = f"the contrast {settings.text or settings.id!r} ({level} against {other})"
            for name in study.metrics_of(settings):
                own = {"contrast": settings.id, "metric": name, **row._asdict()}
                yield _Judged(contrasts, own, what, name, [*itertools.chain(*row.sides)], settings)
    for claim in study.file.claim:
        variants = claim.variants or _of_levels(study, claim, claim.named) or list(study.levels)
        yield _Judged(claims, {"claim": claim.id}, f"the claim {claim.id!r}", claim.metric, variants, claim)


def _of_levels(study: Study, claim: ClaimSettings, sides: Sequence[str]) -> list[str]:
    """Return the variants of some sides of a claim, those at each level that it averages over."""
    along = study.along(claim.over, claim.cells) if claim.over else {name: [name] for name in study.levels}
    return [variant for side in sides for variant in along.get(side, ())]


def undecided(
    study: Study, runs: "pd.DataFrame", contrasts: "pd.DataFrame", claims: "pd.DataFrame"
) -> tuple["pd.DataFrame", "pd.DataFrame", list[str]]:
    """Return contrasts and claims without the verdicts that longer times could change, and a line for each row.

    A verdict that stays is of an estimate that is only a bound.
    """
    found = at_ceiling(study, runs)
    contrasts, claims = contrasts.copy(), claims.copy()
    rows = [row for row in _rows(study, contrasts, claims) if row.is_row.any()]
    lines = list(itertools.chain.from_iterable(_undecide(study, row, found) for row in rows))
    lines += itertools.chain.from_iterable(_take_back_equivalence(study, runs, row) for row in rows)
    return contrasts, claims, list(dict.fromkeys(lines))


def _undecide(study: Study, row: _Judged, found: Mapping[tuple[str, str], AtCeiling]) -> Iterator[str]:
    """Replace the verdict of a row at its ceiling, unless it stays; yield the line that says what happened."""
    at = [variant for variant in row.variants if (row.metric, variant) in found]
    if not at:
        return
    if isinstance(row.of, ClaimSettings):
        if row.of.kind == "predicts" and 2 * len(at) <= len(row.variants):
            return
        less = _of_levels(study, row.of, [row.of.less])
        kept, verdict = _claim_kept(row, at, less, found[row.metric, at[0]].horizon_s), "undecided"
    else:
        at.sort(key=lambda variant: row.variants.index(variant) % 2)  # the sides with the level come first
        is_level, is_reference = (bool({*row.variants[side::2]} & {*at}) for side in (0, 1))
        kept, verdict = _contrast_kept(is_level, is_reference) if len(row.variants) == 2 else (), "unclear"
    is_row = row.is_row
    is_kept = row.table.loc[is_row, "verdict"].iloc[0] in kept
    if not is_kept:
        row.table.loc[is_row, "verdict"] = verdict
    each = found[row.metric, at[0]]
    share = (
        f"{each.reached} of {each.n} values of {study.metrics[row.metric].title!r} in {study.variant_title(at[0])!r}"
    )
    told = "Only a bound: the estimate of" if is_kept else "Not decided:"
    yield f"{told} {row.what}, since {share} are at their ceiling, the horizon of {each.horizon_s:g} s."


def _take_back_equivalence(study: Study, runs: "pd.DataFrame", row: _Judged) -> Iterator[str]:
    """Take back an equivalence that the ceiling alone brings about, since no value could exceed the margin.

    Yield a line if so. Values of 147 s below a ceiling of 150 s are within 1.1 times of whatever is compared.
    """
    is_claim = isinstance(row.of, ClaimSettings)
    without, told = ({"holds": "undecided"}, "Not decided") if is_claim else (NOT_WITHIN, "Not shown to be alike")
    is_row = row.is_row & row.table["verdict"].isin([*without])
    if (isinstance(row.of, ClaimSettings) and row.of.kind != "alike") or not is_row.any():
        return
    if why := _no_room(study, runs, row.metric, row.variants, row.of.margin):
        row.table.loc[is_row, "verdict"] = row.table.loc[is_row, "verdict"].map(without)
        yield f"{told}: {row.what}, since {why}."


def _no_room(study: Study, runs: "pd.DataFrame", name: str, variants: Sequence[str], margin: float) -> str:
    """Return why the ceiling makes an equivalence trivial; "" if it does not."""
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


def _contrast_kept(is_level: bool, is_reference: bool) -> tuple[str, ...]:
    """Return the verdict that stays, whichever longer times one side has; none if both are at their ceiling."""
    return () if is_level and is_reference else ("higher",) if is_level else ("lower",)


def _claim_kept(row: _Judged, of: Sequence[str], less: Sequence[str], horizon_s: float) -> tuple[str, ...]:
    """Return the verdicts of a claim that stay, whichever longer times these variants have."""
    claim = row.of
    assert isinstance(claim, ClaimSettings)
    if claim.kind == "order":
        is_less = {variant in less for variant in of}
        return () if len(is_less) > 1 else ("refuted",) if is_less == {True} else ("holds",)
    if len(of) > 1 or claim.kind in ("predicts", "trend"):
        return ()
    if claim.kind == "value":
        least, most = claim.region
        return ("refuted",) if most < horizon_s else ("holds",) if claim.above is not None and least < horizon_s else ()
    if claim.kind == "published":
        return ("differs",) if (claim.published or 0.0) < horizon_s else ()
    own = row.table.loc[row.is_row].iloc[0]
    is_beyond = own["estimate"] > (claim.region[1] if own["scale"] == RATIO else 0.0)
    return ("refuted",) if is_beyond == (of[0] == claim.a) else ()  # longer times lead away from the region


def shown(text: str, value: float | None, metric: StudyMetric, study: Study, variant: str) -> str:
    """Return the text of a value, or that the value is at its ceiling."""
    horizon_s = ceiling_s(metric, study, variant)
    return f"> {horizon_s:g}" if horizon_s is not None and value is not None and value >= horizon_s else text
