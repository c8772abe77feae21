"""Check the figures of a study for lines that a reader could not tell apart, and for statements that would be false."""

from collections.abc import Iterator, Sequence
from typing import Any

from deltaswarm_scenario.scenario import Scenario, content_of
from deltaswarm_studies.kinds import KINDS, MOST_LOOKS
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import Problem


def figure_problems(study: Study) -> Iterator[Problem]:
    """Yield the mistakes in figures whose names all refer to something."""
    for place, figure in enumerate(study.file.figure):
        for problem in (
            *_one_line_of_many(study, figure),
            *_too_many(study, figure),
            *_not_drawn(study, figure),
            *_spans(study, figure),
        ):
            yield Problem(f"figure[{place}].{problem.path}", problem.given, problem.allowed)


def _variants(study: Study, figure: FigureSettings) -> Sequence[str]:
    return figure.variants or list(study.levels)


def _one_line_of_many(study: Study, figure: FigureSettings) -> Iterator[Problem]:
    """Report a figure over time or of single events that would draw several variants as one line."""
    kind = KINDS[figure.kind]
    if not (kind.is_over_time or (kind.is_of_events and figure.hue)):
        return
    lines: dict[tuple[str, ...], str] = {}
    for variant in _variants(study, figure):
        line = tuple(study.levels[variant].get(factor, "") for factor in (figure.hue, figure.facet))
        other = lines.setdefault(line, variant)
        if other != variant:
            allowed = f"must tell all variants apart, with facet: {other!r} and {variant!r} would be one line"
            yield Problem("hue", repr(figure.hue) if figure.hue else "missing", allowed)
            return


def _too_many(study: Study, figure: FigureSettings) -> Iterator[Problem]:
    hues = {study.levels[name][figure.hue] for name in _variants(study, figure)} if figure.hue else ()
    lines = len(_variants(study, figure)) if KINDS[figure.kind].is_of_events and not figure.hue else 0
    counts = {
        "hue": len(hues),
        "variants": lines,
        "paths": len(figure.paths) + len(figure.variants) if figure.paths else 0,
    }
    for name, count in counts.items():
        if count > MOST_LOOKS:
            other = _INSTEAD[name]
            yield Problem(name, f"{count} to tell apart", f"must be at most {MOST_LOOKS}; {other}")


_INSTEAD = {
    "hue": "a factor of more levels can be x or facet",
    "variants": "name those to show, or divide them by hue and facet",
    "paths": "with the variants beside them",
}


def _not_drawn(study: Study, figure: FigureSettings) -> Iterator[Problem]:
    """Report paths and published numbers of variants that the figure does not show, or that would be in every panel."""
    variants = _variants(study, figure)
    for name in figure.path:
        if name not in variants:
            yield Problem("path", repr(name), "must be one of the figure's variants")
    levels = [study.levels[name] for name in variants]
    cells = (
        {", ".join(level[factor] for factor in (figure.x, figure.hue) if factor) for level in levels}
        if figure.published
        else set()
    )
    for name in figure.published:
        if name not in cells:
            yield Problem("published", repr(name), "must be of one of the figure's variants")
    if figure.published and figure.facet:
        yield Problem("published", "with facet", "must be left out: the numbers would stand in every panel")


def _spans(study: Study, figure: FigureSettings) -> Iterator[Problem]:
    """Report stretches that would be marked in panels in whose runs nothing happens then, unlike in others."""
    known = study.factors.get(figure.facet, ())
    scenarios = {variant.label: variant.scenario for variant in study.sweep.variants}
    for place, span in enumerate(figure.spans):
        where = f"spans[{place}].levels"
        for name in span.levels:
            if name not in known:
                allowed = f"must be levels of the facet, of {', '.join(map(repr, known)) or 'which there is none'}"
                yield Problem(where, repr(name), allowed)
        marked = [
            (level, any(span.from_s in _numbers(scenarios[name]) for name in _of(study, figure, level)))
            for level in span.levels or known
            if level in known
        ]
        idle = [level for level, happens in marked if not happens]
        if idle and len(idle) < len(marked):
            happening = [level for level, happens in marked if happens]
            given = ", ".join(map(repr, span.levels)) or "all panels"
            allowed = f"must be {', '.join(map(repr, happening))}: at {span.from_s:g} s nothing happens in "
            yield Problem(where, given, f"{allowed}{', '.join(map(repr, idle))}")


def _of(study: Study, figure: FigureSettings, level: str) -> list[str]:
    return [name for name in _variants(study, figure) if study.levels[name][figure.facet] == level]


def _numbers(scenario: Scenario) -> set[float]:
    found: set[float] = set()
    waiting: list[Any] = [content_of(scenario)]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict | list):
            waiting += value.values() if isinstance(value, dict) else value
        elif isinstance(value, int | float):
            found.add(float(value))
    return found
