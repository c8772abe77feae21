"""Check a study's tables against each other and its sweep: names, times, and what can be compared."""

import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from typing import Any

from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.summary import summarise
from deltaswarm_orchestrator.sweeps.plan import flattened
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_studies.ceilings import ceiling_problems
from deltaswarm_studies.claim_settings import OF_ORDER
from deltaswarm_studies.event_checks import MOMENTS, asked, event_problems
from deltaswarm_studies.figure_checks import figure_problems
from deltaswarm_studies.kinds import KINDS
from deltaswarm_studies.metrics import BUILT_IN, COLUMN, WINDOW, controllers_own, source_of
from deltaswarm_studies.possible import impossible_claims, unknown_readings
from deltaswarm_studies.settings import listed
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import Problem, did_you_mean

PER_STEP = ("frames_sent", "frames_received", "senders")
"""Metrics that count what an agent does at most once a step."""

TIMES = ("run.step_s", "run.duration_s")
"""Keys on which windows of time depend."""

REPORT_EVERY = "report_every_s"
"""The option by which a controller reports at times that do not depend on the step, if it has one."""

SHORT_LIST = 12
"""Most names that a message lists each time."""


def problems_of(study: Study) -> Iterator[Problem]:
    """Yield all mistakes; further ones only if all names refer to something."""
    named = [*_unknown_names(study), *_repeated_names(study)]
    yield from named
    if not named:
        yield from _results(study)
        yield from _times(study)
        yield from _columns(study)
        yield from _sensitivity(study)
        yield from figure_problems(study)
        yield from _incomparable(study)
        yield from event_problems(study)
        yield from ceiling_problems(study)
        yield from unknown_readings(study)
        yield from impossible_claims(study)


def used_metrics(study: Study) -> list[str]:
    """List every metric that the study tabulates, tests or draws by run."""
    file = study.file
    names = [*file.study.metrics, *(name for contrast in file.contrast for name in contrast.metrics)]
    names += [name for claim in file.claim for name in (claim.metric, *claim.predictors)]
    names += [target.metric for fit in file.fit for target in fit.targets]
    names += [grid.metric for grid in file.grid]
    for figure in file.figure:
        kind = KINDS[figure.kind]
        names += [] if kind.is_over_time or kind.is_of_events else [getattr(figure, name) for name in kind.metrics]
    return list(dict.fromkeys(names))


def _unknown_names(study: Study) -> Iterator[Problem]:
    """Report each unknown name once, with its places, and list the names of a long choice once."""
    places: dict[tuple[str, tuple[str, ...]], tuple[Any, list[str]]] = {}
    for where, names, known in _references(study):
        for name in names:
            if name not in known:
                places.setdefault((repr(name), tuple(known)), (name, []))[1].append(where)
    listed_already: set[tuple[str, ...]] = set()
    for (_, known), (name, wheres) in places.items():
        others = len(dict.fromkeys(wheres)) - 1
        also = f" and {others} other place{'s' * (others > 1)}" if others else ""
        yield _unknown_name(wheres[0] + also, name, known, listed_already)


def _unknown_name(where: str, name: Any, known: Collection[str], listed_already: set[tuple[str, ...]]) -> Problem:
    names, hint = tuple(known), did_you_mean(name, known).rstrip()
    is_long = len(names) > SHORT_LIST
    if is_long and (hint or names in listed_already):
        allowed = f"must be one of the {len(names)} names" + ("" if hint else " listed above")
    else:
        allowed = f"must be one of {', '.join(map(repr, names)) or 'none that is declared'}"
        listed_already.add(names)
    return Problem(where, repr(name) + (hint and f"; {hint}"), allowed)


def _references(study: Study) -> Iterator[tuple[str, Sequence[str], Collection[str]]]:
    """Yield each place that refers to something by name: the place, its names, and the names that exist."""
    file, factors, metrics = study.file, study.factors, study.metrics
    variants = list(study.levels)
    yield "study.words", list(file.study.words), [*factors, *itertools.chain(*factors.values())]
    yield "study.metrics", file.study.metrics, metrics
    for i, contrast in enumerate(file.contrast):
        where, levels = f"contrast[{i}]", factors.get(contrast.factor, ())
        yield f"{where}.metrics", contrast.metrics, metrics
        yield f"{where}.factor", [contrast.factor], factors
        yield f"{where}.reference", [contrast.reference] if contrast.reference else [], levels
        yield f"{where}.pairs", [*itertools.chain(*contrast.pairs)], levels
        yield (
            f"{where}.over",
            [contrast.over] if contrast.over else [],
            [one for one in factors if one != contrast.factor],
        )
        yield f"{where}.cells", contrast.cells, factors.get(contrast.over, ())
        if contrast.across:
            yield f"{where}.across", [contrast.across], [name for name in factors if name != contrast.factor]
            yield f"{where}.across_pairs", [*itertools.chain(*contrast.across_pairs)], factors.get(contrast.across, ())
    for i, claim in enumerate(file.claim):
        yield f"claim[{i}].metric", [claim.metric, *claim.predictors], metrics
        along = study.along(claim.over, claim.cells) if claim.over else {}
        yield f"claim[{i}].over", [claim.over] if claim.over else [], factors
        yield f"claim[{i}].cells", claim.cells, factors.get(claim.over, ())
        yield f"claim[{i}] ({claim.id})", [*claim.named, *filter(None, [claim.reference])], along or variants
    for i, recovery in enumerate(file.recovery):
        yield f"recovery[{i}].metric", [recovery.metric], study.over_time
        yield f"recovery[{i}].factor", [recovery.factor], factors
        yield f"recovery[{i}].level", [recovery.level, recovery.reference], factors.get(recovery.factor, ())
    for i, fit in enumerate(file.fit):
        yield f"fit[{i}].factor", [fit.factor], factors
        yield f"fit[{i}].targets", [target.level for target in fit.targets], factors.get(fit.factor, ())
        yield f"fit[{i}].targets", [target.metric for target in fit.targets], metrics
    for i, grid in enumerate(file.grid):
        yield f"grid[{i}].metric", [grid.metric], metrics
        yield f"grid[{i}]", [grid.rows, grid.factor], [name for name in factors if len(factors) == 2]
        yield f"grid[{i}].columns", [*itertools.chain(*grid.columns.values())], factors.get(grid.factor, ())
    for each in asked(study):
        yield f"{each.where}.metric", [each.settings.metric], MOMENTS
        yield f"{each.where}.variants", [*each.settings.variants, *each.references], variants
    for i, figure in enumerate(file.figure):
        where, drawn = f"figure[{i}]", KINDS[figure.kind]
        for name in drawn.metrics:
            known = MOMENTS if drawn.is_of_events else study.over_time if drawn.is_over_time else metrics
            yield f"{where}.{name}", [getattr(figure, name)], known
        for name in drawn.factors:
            yield f"{where}.{name}", [getattr(figure, name)] if getattr(figure, name) else [], factors
        paths = itertools.chain(*figure.paths.values())
        yield f"{where}.variants", [*figure.variants, *figure.path, *paths], variants
        levels, hues = factors.get(figure.x, ()), factors.get(figure.hue, ())
        boxes = [f"{level}, {hue}" for level in levels for hue in hues] if figure.hue else levels
        yield f"{where}.published", list(figure.published), boxes
        yield f"{where}.lines", [value for value in figure.lines.values() if isinstance(value, str)], variants
    ids = {"claim": [claim.id for claim in file.claim], "contrast": [contrast.id for contrast in file.contrast]}
    ids |= {"fit": [fit.text for fit in file.fit]}
    for i, finding in enumerate(file.finding):
        for j, result in enumerate(finding.results):
            kind = next(kind for kind in ids if kind in result)
            yield f"finding[{i}].results[{j}].{kind}", [str(name) for name in listed(result[kind])], ids[kind]


def _repeated_names(study: Study) -> Iterator[Problem]:
    file = study.file
    for table, name, values in (
        ("metric", "name", [*BUILT_IN, *(one.name for one in file.metric), *(one.name for one in study.ranges)]),
        ("contrast", "id", [contrast.id for contrast in file.contrast]),
        ("claim", "id", [claim.id for claim in file.claim]),
        ("figure", "name", [figure.name for figure in file.figure]),
    ):
        for value, times in Counter(values).items():
            if times > 1:
                yield Problem(f"{table}.{name}", f"{times} called {value!r}", "must be different names")


def _results(study: Study) -> Iterator[Problem]:
    file = study.file
    rows: dict[str, dict[str, list[str]]] = {}
    for contrast in file.contrast:
        comparisons = list(study.comparisons(contrast))
        rows[contrast.id] = {"metric": list(study.metrics_of(contrast))}
        rows[contrast.id] |= {
            name: [getattr(row, name) for row in comparisons] for name in ("level", "reference", "within")
        }
    listed_already: set[tuple[str, ...]] = set()
    for i, finding in enumerate(file.finding):
        for j, result in enumerate(finding.results):
            for id in listed(result.get("contrast", [])):
                for name, values in rows[id].items():
                    for value in listed(result.get(name, [])):
                        if value not in values:
                            where, known = f"finding[{i}].results[{j}].{name}", dict.fromkeys(values)
                            yield _unknown_name(where, value, known, listed_already)


# Times


def _times(study: Study) -> Iterator[Problem]:
    file, settings = study.file, study.file.study
    every_s = study.sweep.file.sweep.series_every_s
    scenarios = study.sweep.scenarios
    end_s = min(scenario.run.duration_s for scenario in scenarios)
    windowed = [f"figure[{i}]" for i, figure in enumerate(file.figure) if figure.kind == "time"]
    windowed += [f"recovery[{i}]" for i in range(len(file.recovery))]
    needy = [*windowed, *(name for name in used_metrics(study) if study.metrics[name].needs_series)]
    if needy and not every_s:
        yield Problem("sweep.series_every_s", "0", f"must be above 0 for {needy[0]}")
        return
    if windowed:
        yield from _not_whole("study.window_s", settings.window_s, every_s)
    stretches = [("study", settings.from_s, settings.until_s)]
    stretches += [
        (f"metric[{i}]", metric.from_s, metric.until_s) for i, metric in enumerate(file.metric) if metric.kind == WINDOW
    ]
    for where, from_s, until_s in stretches:
        yield from _stretch(where, from_s, until_s, every_s, end_s)
    moments = [(f"recovery[{i}].after_s", recovery.after_s) for i, recovery in enumerate(file.recovery)]
    for i, figure in enumerate(file.figure):
        moments += [(f"figure[{i}].at_s", figure.at_s)] if figure.kind == "swarm" else []
        moments += [(f"figure[{i}].spans[{j}].from_s", span.from_s) for j, span in enumerate(figure.spans)]
    yield from (_past_the_end(where, time_s, end_s) for where, time_s in moments if time_s >= end_s)
    horizon_s = max(scenario.metrics.horizon_s for scenario in scenarios)
    for name in used_metrics(study):
        metric = study.metrics[name]
        if not metric.needs_series and (settings.from_s or settings.until_s is not None):
            allowed = f"cannot be applied to {name!r}, which has no time series"
            yield Problem("study.from_s", f"{settings.from_s:.15g}", allowed)
        if source_of(metric) and metric.from_s + horizon_s >= end_s:
            longest = f"{end_s - metric.from_s:.15g} for {name!r}"
            allowed = f"must be less than {longest}: no event could be followed for that long"
            yield Problem("metrics.horizon_s", f"{horizon_s:.15g}", allowed)


def _stretch(where: str, from_s: float, until_s: float | None, every_s: float, end_s: float) -> Iterator[Problem]:
    for name, time_s in (("from_s", from_s), ("until_s", until_s)):
        if time_s is not None and every_s:
            yield from _not_whole(f"{where}.{name}", time_s, every_s)
    if from_s >= end_s:
        yield _past_the_end(f"{where}.from_s", from_s, end_s)
    elif until_s is not None and until_s <= from_s:
        yield Problem(f"{where}.until_s", f"{until_s:.15g}", f"must be after {where}.from_s, {from_s:.15g} s")


def _not_whole(where: str, time_s: float, every_s: float) -> Iterator[Problem]:
    if not math.isclose(time_s / every_s, round(time_s / every_s), rel_tol=1e-9, abs_tol=1e-9):
        yield Problem(where, f"{time_s:.15g}", f"must be a multiple of sweep.series_every_s, {every_s:.15g} s")


def _past_the_end(where: str, time_s: float, end_s: float) -> Problem:
    return Problem(where, f"{time_s:.15g}", f"must be before the end of the runs, {end_s:.15g} s")


# Columns and comparisons


def _sensitivity(study: Study) -> Iterator[Problem]:
    file = study.file
    if study.ranges and not file.claim:
        yield Problem("claim", "none", "must be at least one [[claim]]: a sensitivity study says where claims hold")
    for i, claim in enumerate(file.claim if study.ranges else ()):
        if claim.kind not in ("order", "value", "alike"):
            allowed = "must be order, value or alike in a sensitivity study, which judges a claim at each point"
            yield Problem(f"claim[{i}].kind", repr(claim.kind), allowed)
        for name in OF_ORDER:
            if given := getattr(claim, name):
                yield Problem(f"claim[{i}].{name}", repr(given)[:60], "must be left out of a sensitivity study")
    windowed = [name for name in used_metrics(study) if study.metrics[name].needs_series]
    windowed += [f"figure {figure.name!r}" for figure in file.figure if KINDS[figure.kind].is_over_time]
    windowed += ["recovery"] if file.recovery else []
    for i, one in enumerate(study.ranges):
        if one.name in TIMES and windowed:
            allowed = f"must not be drawn with {windowed[0]}, whose windows must be the same in all runs"
            yield Problem(f"sensitivity.range[{i}].name", repr(one.name), allowed)


def _columns(study: Study) -> Iterator[Problem]:
    compared = {(name, variant) for _, name, variants in _compared(study) for variant in variants}
    columns = {
        variant.label: {*dict(flattened(summarise(Outcome(), variant.scenario))), *study.sweep.swept}
        for variant in study.sweep.variants
    }
    for name in used_metrics(study):
        metric = study.metrics[name]
        for variant in study.sweep.variants:
            is_optional = name in controllers_own(study.sweep) and (name, variant.label) not in compared
            if is_optional or metric.kind != COLUMN:
                continue
            is_of_person = metric.column.startswith(("person.", "inbox.", "shown_s.", "read_s."))
            is_on = variant.scenario.operator.person.is_on
            if not (is_on if is_of_person else metric.column in columns[variant.label]):
                allowed = f"must be a column of the sweep's table; {variant.label!r} has none"
                yield Problem(f"metric {name!r}", repr(metric.column), allowed)
                break


def _incomparable(study: Study) -> Iterator[Problem]:
    scenarios = {variant.label: variant.scenario for variant in study.sweep.variants}
    if len({scenario.run.step_s for scenario in scenarios.values()}) == 1:
        return
    for where, name, variants in _compared(study):
        of = study.metrics[name].of or name
        intervals_s = {_interval_s(of, scenarios[variant]) for variant in variants}
        if len(intervals_s) > 1:
            allowed = f"must not be compared between {' and '.join(map(repr, variants))}: it depends on run.step_s"
            yield Problem(where, repr(name), allowed)


def _compared(study: Study) -> Iterator[tuple[str, str, Sequence[str]]]:
    """Yield the key, the metric and the variants of each comparison."""
    for i, contrast in enumerate(study.file.contrast):
        for row in study.comparisons(contrast):
            yield from (
                (f"contrast[{i}].metrics", name, side) for side in row.sides for name in study.metrics_of(contrast)
            )
    yield from ((f"claim[{i}].metric", claim.metric, claim.variants) for i, claim in enumerate(study.file.claim))


def _interval_s(metric: str, scenario: Scenario) -> float:
    """Return the time between an agent's messages of this metric if the step bounds it [s]; 0 if it does not."""
    step_s = scenario.run.step_s
    if metric == "messages":
        every_s = scenario.control.options.get(REPORT_EVERY, 0.0)
        return step_s if step_s > every_s else 0.0
    return step_s if metric in PER_STEP else 0.0
