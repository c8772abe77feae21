"""Check before the runs that each claim of a study can both hold and be contradicted."""

import math
from collections.abc import Iterator

from deltaswarm_orchestrator.results.metric import Metric
from deltaswarm_orchestrator.results.summary import EVERY_KEY
from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.claim_settings import ClaimSettings
from deltaswarm_studies.event_checks import scenarios_of
from deltaswarm_studies.metrics import CONVERGENCE, COUNTS
from deltaswarm_studies.stats import ALPHA, Interval
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import Problem, did_you_mean, plain

OF_TREES = ("agents_in_trees", "trees")
OF_AGENTS = (*OF_TREES, "senders")
ONCE_A_STEP = ("messages", "frames_sent")
"""Metrics of which each agent adds at most one a step."""
SHARES = ("person_utilisation", "person_load")
SCALES = {"person_isa": (1.0, 5.0)}
ANYTHING: Interval = (-math.inf, math.inf)


def impossible_claims(study: Study) -> Iterator[Problem]:
    """Report claims that could hold with no number of runs, and claims that no run could contradict."""
    sources = [claim.source for claim in study.file.claim]
    for i, claim in enumerate(study.file.claim):
        alpha = ALPHA / sources.count(claim.source)
        for name, got, why in _reasons(study, claim, alpha):
            yield Problem(f"claim[{i}].{name}", got, f"{why} (the claim {claim.id!r})")


def unknown_readings(study: Study) -> Iterator[Problem]:
    """Report readings that are said to be chosen by a number, and that are neither keys of the scenario nor metrics."""
    if not any(claim.calibrated for claim in study.file.claim):
        return
    keys = {name: None for variant in study.sweep.variants for name, _ in flattened(plain(variant.scenario))}
    known = [*keys, *study.metrics]
    for i, claim in enumerate(study.file.claim):
        for name in claim.calibrated:
            if name not in known:
                hint = did_you_mean(name, known).rstrip()
                got = repr(name) + (hint and f"; {hint}")
                yield Problem(f"claim[{i}].calibrated", got, "must be a key of the scenario, or a metric")


def _reasons(study: Study, claim: ClaimSettings, alpha: float) -> Iterator[tuple[str, str, str]]:
    """Yield the key, its value and the reason for each thing that is impossible about a claim."""
    if claim.expect not in (*claim.verdicts, "holds", "refuted"):
        yield "expect", repr(claim.expect), f"must be one of {', '.join(claim.verdicts)}: no other verdict can come out"
    if claim.kind == "predicts":
        if claim.metric in claim.predictors:
            what = "nothing could hold" if claim.less == claim.metric else "nothing could contradict"
            yield (
                "metric",
                repr(claim.metric),
                f"must not be one of the predictors, since it predicts itself: {what} it",
            )
        return
    if claim.of:
        yield from _of_value(study, claim, alpha)
    elif claim.kind == "alike" or (claim.more and not claim.over):
        yield from _of_two(study, claim)


def _of_value(study: Study, claim: ClaimSettings, alpha: float) -> Iterator[tuple[str, str, str]]:
    least, most = claim.region
    if math.isnan(least):
        return
    name, got = ("within", f"{least:g} to {most:g}") if claim.above is None else ("above", f"{least:g}")
    half = _half(claim, alpha)
    if 2 * half >= most - least:
        yield (
            name,
            got,
            f"must be wider than {2 * half:.3g}: the error of the published number alone, {half:.3g} to either side at "
            f"the level of its source's claims ({alpha:.2g}), exceeds it, so no number of runs could support it; widen "
            "it, or use kind 'published' without it",
        )
    low, high = bounds(study, claim.metric, claim.of)
    is_above = claim.above is not None
    if most < low or least > high or (is_above and least >= high):
        yield name, got, f"must reach into {low:g} to {high:g}, where {claim.metric} can be: nothing could support it"
    elif least <= low and high <= most:
        yield (
            name,
            got,
            f"must exclude a part of {low:g} to {high:g}, where {claim.metric} can be: nothing could contradict it",
        )
    elif _is_whole(study, claim.metric) and math.ceil(2 * least) > math.floor(2 * most):  # a median may be n + 1/2
        yield name, got, f"must have a whole number in it, as {claim.metric} is: nothing could support it"


def _half(claim: ClaimSettings, alpha: float) -> float:
    """Return half the width of a claim's interval if our runs had no error."""
    if not claim.published_error:
        return 0.0
    from scipy import stats

    quantile = stats.t.isf(alpha / 2, claim.n - 1) if claim.kind == "published" else stats.norm.isf(alpha / 2)
    return float(quantile) * claim.published_error


def _of_two(study: Study, claim: ClaimSettings) -> Iterator[tuple[str, str, str]]:
    """Judge a ratio of two variants by where the metric can be in each, and by whether they differ at all."""
    is_order = claim.kind == "order"
    a, b = (claim.more, claim.less) if is_order else (claim.a, claim.b)
    name = "at_least" if is_order else "margin"
    least, most = claim.region
    (low_a, high_a), (low_b, high_b) = bounds(study, claim.metric, a), bounds(study, claim.metric, b)
    got = f"{claim.at_least if is_order else claim.margin:g} times"
    one, other = ([scenario for _, scenario in scenarios_of(study, [side])] for side in (a, b))
    if one == other:
        what = "support" if is_order and least >= 1 else "contradict"
        yield name, got, f"must not compare {a!r} with {b!r}, whose scenarios are the same: nothing could {what} it"
        return
    # Products rather than ratios, since bounds may be 0.
    too_much = high_a <= least * low_b if is_order else high_a < least * low_b or low_a > most * high_b
    if too_much or (high_a == 0 and is_order):
        where = f"{low_a:g} to {high_a:g} and {low_b:g} to {high_b:g}"
        yield name, got, f"must be within reach of {claim.metric}, which is {where}: nothing could support it"
    elif max(low_a, low_b) > 0 and low_a >= least * high_b and (is_order or high_a <= most * low_b):
        yield (
            name,
            got,
            f"must exclude some values of {claim.metric}, all in {low_a:g} to {high_a:g}: nothing could contradict it",
        )


def bounds(study: Study, name: str, variant: str) -> Interval:
    """Return the least and the largest value that a metric can have in a variant's runs, as far as is known."""
    metric = _entry(study, name)
    if study.metrics[name].kind == CONVERGENCE:
        return 0.0, max(scenario.run.duration_s for _, scenario in scenarios_of(study, [variant]))
    if metric is None:
        return ANYTHING
    if metric.study in SCALES:
        return SCALES[metric.study]
    return 0.0, max(_most(metric, scenario) for _, scenario in scenarios_of(study, [variant]))


def _most(metric: Metric, scenario: Scenario) -> float:
    width_m, height_m, count = scenario.arena.width_m, scenario.arena.height_m, scenario.agents.count
    if metric.study in OF_TREES and scenario.control.mode == "decentralised":
        return 0.0
    if metric.unit == "s" and not metric.key.startswith("wall"):
        return scenario.metrics.horizon_s if metric.is_restricted else scenario.run.duration_s
    if metric.study in SHARES or metric.key.endswith(("_share", "beyond_horizon")):
        return 1.0
    if metric.study in OF_AGENTS:
        return count
    if metric.study in ONCE_A_STEP:
        return count / scenario.run.step_s
    return {"m": math.hypot(width_m, height_m), "m²": width_m * height_m}.get(metric.unit, math.inf)


def _entry(study: Study, name: str) -> Metric | None:
    metric = study.metrics[name]
    return next((one for one in EVERY_KEY if one.study == (metric.of or name) or one.key == metric.column), None)


def _is_whole(study: Study, name: str) -> bool:
    entry = _entry(study, name)
    return entry is not None and study.metrics[name].kind != CONVERGENCE and (entry.is_whole or entry.study in COUNTS)
