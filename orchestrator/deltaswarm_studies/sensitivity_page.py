"""The part of a page that shows a sensitivity study: shares, the keys that turn claims, and figures of both."""

import math
import textwrap
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from deltaswarm_orchestrator.sweeps.sensitivity import LOG, RangeSettings
from deltaswarm_studies import stats, style
from deltaswarm_studies.claim_settings import ClaimSettings
from deltaswarm_studies.rendering import CaptionedFigure, Table, number, p_value, table
from deltaswarm_studies.sensitivity import NEITHER, TURNS, Feature, Sensitivity, tests_in
from deltaswarm_studies.study import Study
from deltaswarm_studies.style import Look

HOLDS, FAILS = Look("#004488", "o", ""), Look("#bb5566", "X", "")

FIGURE = "sensitivity"
"""Name of the figure of all correlations; those of the claims are numbered from 1."""

DARK = 0.6
"""Correlations beyond this have a colour on which only white is legible."""

MATRIX = """
Rank correlation (Spearman) of what is drawn with each claim's effect. Bold: p (Holm) is at most 0.05 among the {tests}
correlations of this section. Framed: what is drawn is correlated with whether the claim holds, too, and so turns it."""

TURNING = """
{text}. Effect at each of {n} points, against the two drawn keys with the strongest rank correlations: {strongest}.
{shown} The claim holds at {holds} points. Each point is {each} of each side."""


def section(study: Study, result: Sensitivity) -> dict[str, Any]:
    return {
        "heading": "Sensitivity",
        "tables": list(_tables(study, result)),
        "pictures": list(_pictures(study, result)),
    }


def facts(study: Study, result: Sensitivity) -> dict[str, Any]:
    return {
        "method": result.settings.design,
        "points": result.settings.points,
        "ran": study.repeats,
        "each": study.sweep.runs_per_point,
        "variants": len(study.sweep.variants),
        "tests": tests_in(result.keys),
    }


def _tables(study: Study, result: Sensitivity) -> Iterator[Table]:
    shares = result.shares.copy()
    shares["interval"] = [_interval(row) for _, row in shares.iterrows()]
    shares["turned"] = [_turned(result, claim) for claim in shares["claim"]]
    headings = {
        "text": "Claim",
        "n": "Points with runs",
        "missing": "Points without",
        "holds": "Holds at",
        "ties": "Ties",
    }
    yield table(shares, {**headings, "interval": "Share [%]", "turned": "Turned by"}, "Where each claim holds")
    shown = result.keys[result.keys["verdict"] != NEITHER]
    if len(shown):
        texts = {claim.id: claim.text for claim in study.file.claim}
        rows = shown.assign(
            text=[texts[claim] for claim in shown["claim"]],
            of_effect=[_correlation(row["rho"], row["p_holm"]) for _, row in shown.iterrows()],
            of_holds=[_correlation(row["rho_holds"], row["p_holds_holm"]) for _, row in shown.iterrows()],
            low=[_percent(share) for share in shown["share_low"]],
            high=[_percent(share) for share in shown["share_high"]],
        )
        headings = {"text": "Claim", "title": "Drawn", "of_effect": "With the effect", "of_holds": "With holding"}
        headings |= {"low": "Holds low [%]", "high": "Holds high [%]", "verdict": "What it does"}
        yield table(rows, headings, f"Significant rank correlations, of {tests_in(result.keys)} tested together")
    space = pd.DataFrame([{"title": one.label, "from": one.distribution} for one in result.settings.range])
    yield table(space, {"title": "Drawn", "from": "From"}, "The space that the points were drawn from")


def _turned(result: Sensitivity, claim: str) -> str:
    keys = result.keys[result.keys["claim"] == claim]
    ends = {one.title: ("where low", "where high") if one.is_number else ("without", "with") for one in result.features}
    turning = keys[keys["verdict"] == TURNS].sort_values("rho_holds", key=np.abs, ascending=False)
    words = []
    for _, row in turning.iterrows():
        low, high = ends[row["title"]]
        words.append(f"{row['title']} ({_percent(row['share_low'])} % {low}, {_percent(row['share_high'])} % {high})")
    return "; ".join(words) or "no significant key"


def _interval(row: Any) -> str:
    return f"{_percent(row['share'])} [{_percent(row['low'])}, {_percent(row['high'])}]" if row["n"] else "-"


def _percent(share: float) -> str:
    return number(100 * share, 0)


def _correlation(rho: float, p: float) -> str:
    return "-" if math.isnan(rho) else f"{rho:.2f} (p {'' if p < 0.001 else '= '}{p_value(p)})"


def _pictures(study: Study, result: Sensitivity) -> Iterator[CaptionedFigure]:
    if result.keys["rho"].isna().all():
        return
    caption = MATRIX.format(tests=tests_in(result.keys))
    yield CaptionedFigure(FIGURE, matrix(study, result), " ".join(caption.split()))
    for i, claim in enumerate(study.file.claim, 1):
        strongest = result.strongest(claim.id)[:2]
        if not strongest:
            continue
        share = result.shares[result.shares["claim"] == claim.id].iloc[0]
        own = result.keys[(result.keys["claim"] == claim.id) & (result.keys["verdict"] != NEITHER)]
        are_shown = all(feature.title in set(own["title"]) for feature in strongest)
        caption = TURNING.format(
            text=claim.text,
            n=share["n"],
            holds=share["holds"],
            strongest=" and ".join(_plain(feature.title) for feature in strongest),
            each="one run" if study.sweep.runs_per_point == 1 else f"the mean of {study.sweep.runs_per_point} runs",
            shown="" if are_shown else "Not each is shown to matter.",
        )
        drawing = turning(study, result, claim, strongest)
        yield CaptionedFigure(f"{FIGURE}-{i}", drawing, " ".join(caption.split()))


def _plain(title: str) -> str:
    return title.partition(" [")[0]


LETTERS, UPRIGHT_IN = 30, 1.2
"""Titles of more letters below the matrix are upright, in lines of as many; the figure is as much taller [in]."""


def matrix(study: Study, result: Sensitivity) -> Figure:
    """Draw the rank correlation of each feature (columns) with each claim's effect (rows)."""
    claims, titles = [claim.id for claim in study.file.claim], [feature.title for feature in result.features]
    rho = result.keys.pivot(index="claim", columns="title", values="rho").loc[claims, titles].to_numpy(float)
    with style.drawing():
        are_long = max(map(len, titles)) > LETTERS
        figure = style.new_figure(style.TEXT_IN, 1.4 + 0.5 * len(claims) + UPRIGHT_IN * are_long)
        axes = figure.subplots()
        image = axes.imshow(rho, vmin=-1, vmax=1, cmap="RdBu_r", aspect="auto")
        texts = {claim.id: "\n".join(textwrap.wrap(claim.text, 26)) for claim in study.file.claim}
        axes.set_yticks(range(len(claims)), [texts[claim].replace("$", r"\$") for claim in claims])
        turned: dict[str, Any] = {"rotation": 90} if are_long else {"rotation": 40, "ha": "right"}
        texts_below = ["\n".join(textwrap.wrap(title.replace("$", r"\$"), LETTERS)) for title in titles]
        axes.set_xticks(range(len(titles)), texts_below, **turned)
        axes.tick_params(length=0)
        for _, row in result.keys.iterrows():
            x, y = titles.index(row["title"]), claims.index(row["claim"])
            weight = "bold" if row["p_holm"] <= stats.ALPHA else "normal"
            colour = "white" if abs(rho[y, x]) > DARK else style.BLACK
            axes.text(x, y, number(rho[y, x], 2), ha="center", va="center", color=colour, weight=weight, size=6)
            if row["verdict"] == TURNS:
                axes.add_patch(Rectangle((x - 0.47, y - 0.45), 0.94, 0.9, fill=False, edgecolor=style.BLACK))
        figure.colorbar(image, ax=axes, label="rank correlation with the effect", shrink=0.8)
    return figure


def turning(study: Study, result: Sensitivity, claim: ClaimSettings, strongest: list[Feature]) -> Figure:
    """Draw a claim's effect at each point against one or two keys, with where it holds by colour and marker."""
    points = result.points.dropna(subset=[f"effect: {claim.id}"])
    effect, holds = points[f"effect: {claim.id}"], points[f"holds: {claim.id}"] == 1
    is_ratio = claim.id in result.ratios
    label, bounds = _effect_label(study, claim, is_ratio)
    ranges = {one.name: one for one in result.settings.range}
    with style.drawing():
        figure = style.new_figure(style.TEXT_IN, 2.6)
        grid = figure.subplots(1, len(strongest), sharey=True, squeeze=False)[0]
        for axes, feature in zip(grid, strongest, strict=True):
            places = _place(axes, ranges[feature.key], points[feature.key])
            for look, chosen in ((FAILS, ~holds), (HOLDS, holds)):
                edge: dict[str, Any] = {"edgecolors": style.BLACK, "linewidths": 0.3, "s": 12}
                axes.scatter(places[chosen], effect[chosen], marker=look.marker, color=look.colour, **edge)
            for bound in bounds:
                axes.axhline(bound, color=style.BLACK, linewidth=0.7, linestyle=(0, (6, 3)), zorder=0)
            if is_ratio:
                _logarithmic(axes.yaxis, effect)
            axes.set_xlabel(ranges[feature.key].label)
        grid[0].set_ylabel("\n".join(textwrap.wrap(label, 34)))
        handles = [
            Line2D(
                [], [], color=look.colour, marker=look.marker, linestyle="none", markersize=4.5, label=f"{words} ({n})"
            )
            for look, words, n in ((HOLDS, "holds", int(holds.sum())), (FAILS, "does not hold", int((~holds).sum())))
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def _place(axes: Axes, one: RangeSettings, values: pd.Series) -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Return where each value lies along the axis; choices side by side, spread evenly."""
    if not one.choices:
        if one.scale == LOG:
            _logarithmic(axes.xaxis, values)
        return values.to_numpy(float)
    at = {name: place for place, name in enumerate(one.choices)}
    axes.set_xticks(range(len(at)), ["\n".join(textwrap.wrap(name, 14)) for name in one.choices])
    axes.tick_params(axis="x", length=0)
    spread = (np.arange(1, len(values) + 1) * (5**0.5 - 1) / 2) % 1.0 - 0.5  # golden ratio: even and repeatable
    return values.map(at).to_numpy(float) + 0.5 * spread


def _logarithmic(axis: Axis, values: pd.Series) -> None:
    """Make an axis logarithmic, with plain numbers: over less than a decade, powers of ten would leave it bare."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})  # type: ignore[attr-defined]
    is_wide = values.max() >= 10 * values.min()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if is_wide else MaxNLocator(5))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def _effect_label(study: Study, claim: ClaimSettings, is_ratio: bool) -> tuple[str, list[float]]:
    """Return the effect's title with its unit, and the values at which the claim begins to hold."""
    metric = study.metrics[claim.metric]
    region = [bound for bound in claim.region if math.isfinite(bound)]
    unit = f" [{metric.unit}]" if metric.unit else ""
    if claim.kind == "value":
        return f"{metric.title}, {claim.of}{unit}", region
    is_order = claim.kind == "order"
    sides = (claim.more, claim.less) if is_order else (claim.a, claim.b)
    a, b = (side.replace(" ", "\N{NO-BREAK SPACE}") for side in sides)
    if is_ratio:
        return f"{metric.title}: {a} over {b} [times]", region
    multiple = claim.at_least if is_order else claim.ratio
    times = "" if multiple == 1 else f"{multiple:g} times "
    return f"{metric.title}: {a} less {times}{b}{unit}", [0.0] if is_order else []
