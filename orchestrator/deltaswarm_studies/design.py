"""The head of a study's page: its design under the headings of ADEMP, filled from the study file and its scenarios.

Aims, data-generating mechanism, estimands, methods, performance: Morris, White and Crowther 2019, Using simulation
studies to evaluate statistical methods (doi 10.1002/sim.8086).
"""

from collections.abc import Iterable, Iterator, Mapping

from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.checks import used_metrics
from deltaswarm_studies.metrics import COST
from deltaswarm_studies.stats import ALPHA
from deltaswarm_studies.study import Study
from deltaswarm_wire import checked

METHOD_KEYS = ("control.", "operator.", "run.bound")
"""Beginnings of the keys that say how the swarm is controlled; all others belong to the world it meets."""

WORLD = {
    "agents.count": "agents",
    "arena.width_m": "m wide",
    "arena.height_m": "m high",
    "events.rate_hz": "events per s",
    "run.duration_s": "s long",
    "run.step_s": "s a step",
}
"""Keys of the data-generating mechanism that every page shows, with their words."""


def design(study: Study) -> list[tuple[str, list[str]]]:
    parts = {
        "Aims": _aims(study),
        "Data-generating mechanism": _mechanism(study),
        "Estimands": _estimands(study),
        "Methods": _methods(study),
        "Performance": _performance(study),
    }
    return [(heading, list(lines)) for heading, lines in parts.items()]


def _aims(study: Study) -> Iterator[str]:
    yield " ".join(study.file.study.question.split()) or "No question is stated."
    counts = {"claims": study.file.claim, "contrasts": study.file.contrast, "fits": study.file.fit}
    counts |= {"recoveries": study.file.recovery}
    yield f"Asked: {_joined(f'{name} {len(rows)}' for name, rows in counts.items() if rows) or 'estimates only'}."
    if sources := dict.fromkeys(claim.source for claim in study.file.claim if claim.source):
        yield f"Sources of claims: {_joined(sources)}."


def _mechanism(study: Study) -> Iterator[str]:
    scenarios = [variant.scenario for variant in study.sweep.variants]
    drawn = [one.name for one in study.ranges]
    world = [f"{_values(scenarios, name)} {words}" for name, words in WORLD.items() if name not in drawn]
    yield f"Scenario `{study.sweep.file.base.rpartition('/')[2]}`: {', '.join(world)}."
    swept = study.sweep.file.sweep
    yield (
        f"Replicates: {_replicates(study)}. Their seeds are derived from {swept.seed}; "
        "all variants of a replicate have the same seed and see the same arrivals."
    )
    if sensitivity := study.sweep.file.sensitivity:
        ranges = _joined(f"{_lower(one.label)}, {one.distribution}" for one in sensitivity.range)
        each = sensitivity.runs_per_point
        runs = "A replicate is" if each == 1 else f"Every {each} replicates are the runs at"
        yield f"{runs} one of {sensitivity.points} points of {sensitivity.design}, drawn from: {ranges}."
    yield from _varied(study, is_method=False)


def _replicates(study: Study) -> str:
    labels: dict[int, list[str]] = {}
    for label, repeats in study.sweep.repeats.items():
        labels.setdefault(repeats, []).append(label)
    if len(labels) == 1:
        return f"{next(iter(labels))} of each of {len(study.levels)} variants"
    most = max(labels, key=lambda repeats: len(labels[repeats]))
    return "; ".join(
        f"{repeats} of {'each other variant' if repeats == most else _joined(labels[repeats])}"
        for repeats in sorted(labels, key=lambda repeats: (repeats == most, -repeats))
    )


def _estimands(study: Study) -> Iterator[str]:
    yield f"Of each variant, the median over its replicates of: {_joined(_labels(study, used_metrics(study)))}."
    if any(study.metrics[name].kind == COST for name in used_metrics(study)):
        yield (
            "An event's delay is the mean of the times from its arrival until the operator is told of it and until it "
            "is complete. What has not come by the end of the run counts until then. A price is for the messages per "
            "event."
        )
    for contrast in study.file.contrast:
        text = contrast.text or contrast.id
        yield f"{text}: shifts of {_joined(_labels(study, study.metrics_of(contrast)))}."
    means = [(one.over, one.cells) for one in study.file.contrast] + [(one.over, one.cells) for one in study.file.claim]
    for over, cells in dict.fromkeys(mean for mean in means if mean[0]):
        left_out = _joined(level for level in study.factors[over] if cells and level not in cells)
        named = _joined(cells or study.factors[over])
        yield f"Means over {study.factor_title(over)}: {named}{f'; without {left_out}' if left_out else ''}."


def _methods(study: Study) -> Iterator[str]:
    yield f"Control: {_joined(dict.fromkeys(variant.scenario.control.mode for variant in study.sweep.variants))}."
    yield from _varied(study, is_method=True)


def _performance(study: Study) -> Iterator[str]:
    margins: dict[float, list[str]] = {}
    for contrast in study.file.contrast:
        margins.setdefault(contrast.margin, []).append(contrast.text or contrast.id)
    for margin, names in margins.items():
        if margin:
            yield f"Differences within {margin:g} times count as none: {_joined(names)}."
    yield (
        f"Each family of tests has an error of {100 * ALPHA:g} % (Holm). Intervals have the confidence at which a "
        "comparison is tested."
    )
    yield (
        "A number in parentheses after an estimate is its Monte Carlo standard error, by a bootstrap over the "
        "replicates."
    )


def _varied(study: Study, *, is_method: bool) -> Iterator[str]:
    """Yield a line for each factor that varies keys of this kind: the keys, and the levels that differ in them."""
    tables = {variant.label: variant.keys for variant in study.sweep.variants}
    for factor, levels in study.factors.items():
        first: dict[tuple[str, ...], Mapping[str, object]] = {}
        varied, keys = [levels[0]], []
        for label, of in study.levels.items():
            table = tables[label]
            other = first.setdefault(tuple(level for name, level in of.items() if name != factor), table)
            differing = [key for key in {**other, **table} if other.get(key) != table.get(key)]
            differing = [key for key in differing if key.startswith(METHOD_KEYS) == is_method]
            keys += differing
            varied += [of[factor]] if differing else []
        if keys:
            named = _joined(f"`{key}`" for key in dict.fromkeys(keys))
            names = (study.level_name(factor, level) for level in dict.fromkeys(varied))
            yield f"Varied, {study.factor_title(factor)} ({named}): {_joined(names)}."


def _labels(study: Study, names: Iterable[str]) -> list[str]:
    return [_lower(study.metrics[name].label) for name in names]


def _values(scenarios: Iterable[Scenario], key: str) -> str:
    values = [dict(flattened(checked.plain(scenario)))[key] for scenario in scenarios]
    return " or ".join(f"{value:.15g}" for value in dict.fromkeys(values))


def _joined(words: Iterable[str]) -> str:
    """Join words, with semicolons where one of them has a comma."""
    listed = list(words)
    return ("; " if any(", " in word for word in listed) else ", ").join(listed)


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:] if text[1:2].islower() else text
