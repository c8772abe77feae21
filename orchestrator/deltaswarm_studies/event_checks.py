"""The questions of a study about single events, and checks that its runs can answer them."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from deltaswarm_orchestrator.results.outcome import COMPLETED, TOLD, Moment
from deltaswarm_orchestrator.results.summary import EVERY_KEY
from deltaswarm_scenario.scenario import EventSettings, Scenario
from deltaswarm_studies.event_settings import RingsSettings, SurvivalSettings
from deltaswarm_studies.kinds import KINDS
from deltaswarm_studies.settings import FigureSettings
from deltaswarm_studies.study import Study
from deltaswarm_wire.checked import Problem

SURVIVAL, RINGS = "survival", "rings"

MOMENTS: Mapping[str, Moment] = {
    metric.study: metric.moment for metric in EVERY_KEY if metric.study and metric.moment and metric.over
}
"""The four moments of an event, each by the metric of the mean time until it."""


class Asked(NamedTuple):
    """A table or a figure about single events."""

    where: str
    kind: str
    settings: SurvivalSettings | RingsSettings | FigureSettings

    def variants(self, study: Study) -> Sequence[str]:
        return self.settings.variants or list(study.levels)

    @property
    def references(self) -> list[str]:
        reference = getattr(self.settings, "reference", "")
        return [reference] if reference else []


def asked(study: Study) -> list[Asked]:
    """List every table and figure about single events."""
    file = study.file
    found = [Asked(f"survival[{i}]", SURVIVAL, settings) for i, settings in enumerate(file.survival)]
    found += [Asked(f"rings[{i}]", RINGS, settings) for i, settings in enumerate(file.rings)]
    figures = [(i, figure) for i, figure in enumerate(file.figure) if KINDS[figure.kind].is_of_events]
    return found + [Asked(f"figure[{i}]", figure.kind, figure) for i, figure in figures]


def asked_variants(study: Study) -> list[str]:
    """List the variants whose events are asked about, in the study's order; all if nothing is asked."""
    names = {name for each in asked(study) for name in [*each.variants(study), *each.references]}
    return [name for name in study.levels if not names or name in names]


def horizon_s(study: Study, settings: SurvivalSettings | RingsSettings | FigureSettings) -> float:
    """Return the time for which a table or a figure follows events [s]."""
    if settings.horizon_s is not None:
        return settings.horizon_s
    return horizons_s(study, settings.variants or list(study.levels))[0]


def scenarios_of(study: Study, variants: Sequence[str]) -> list[tuple[str, Scenario]]:
    """Return these variants' scenarios, in a sensitivity study those at all points, each with the variant's name."""
    every = [variant for each in study.sweep.points or [study.sweep.variants] for variant in each]
    return [(variant.label, variant.scenario) for variant in every if variant.label in variants]


def horizons_s(study: Study, variants: Sequence[str]) -> list[float]:
    """Return the different horizons of these variants' scenarios, in order [s]."""
    return sorted({scenario.metrics.horizon_s for _, scenario in scenarios_of(study, variants)})


def least_s(moment: Moment, scenario: Scenario) -> tuple[float, str]:
    """Return the shortest time until a moment that the scenario allows [s], and why; 0 if nothing is known.

    An event that arrives beside all agents is complete after its work, shared by all of them. A report takes at least
    the uplink's delay, which is rounded to whole steps.
    """
    step_s, agents = scenario.run.step_s, scenario.agents.count
    if moment is COMPLETED:
        work_s = scenario.events.work_agent_s / agents - step_s
        return max(0.0, work_s), f"the work of {agents} agents on an event (events.work_agent_s)"
    if moment is TOLD:
        return scenario.uplink.latency_s // step_s * step_s, "the delay of a report (uplink.latency_s)"
    return 0.0, ""


def too_short(moment: Moment, study: Study, variants: Sequence[str], followed_s: float | None = None) -> str:
    """Return why no event of some variant can reach a moment within the horizon; "" if it can in all."""
    for name, scenario in scenarios_of(study, variants):
        least, why = least_s(moment, scenario)
        horizon = scenario.metrics.horizon_s if followed_s is None else followed_s
        if horizon <= least:
            return (
                f"must be longer than {least:.6g} s, which {why} takes at least in {name!r}: no event is "
                f"{moment.state} within {horizon:.15g} s, whatever the swarm does"
            )
    return ""


def first_change_s(events: EventSettings) -> float | None:
    """Return when the rate of events first changes, or one of their places jumps [s]; None if neither does."""
    paths = (zip(part.path_s, part.path_m, strict=True) for part in events.density.parts)
    steps = itertools.chain.from_iterable(map(itertools.pairwise, paths))
    jumps_s = [then_s for (before_s, here), (then_s, there) in steps if before_s == then_s and here != there]
    return min([*events.rates_s, *jumps_s], default=None)


def event_problems(study: Study) -> Iterator[Problem]:
    """Yield the reasons why the runs could not answer a question about single events."""
    file = study.file
    for table, all_of in (("survival", file.survival), ("rings", file.rings)):
        called = [(settings.text, settings.metric) for settings in all_of]
        for i, own in enumerate(called):
            if own in called[:i]:
                allowed = f"must differ from that of {table}[{called.index(own)}], which has the same metric"
                yield Problem(f"{table}[{i}].text", repr(own[0]), allowed)
    for i, metric in enumerate(file.metric):
        if metric.after_change and not any(first_change_s(scenario.events) for scenario in study.sweep.scenarios):
            allowed = "must be left out: in no variant anything changes at once (events.rates_s, events.density.path_s)"
            yield Problem(f"metric[{i}].after_change", "true", allowed)
    for each in asked(study):
        yield from _horizon(study, each, [*each.variants(study), *each.references])
        yield from _densest(study, each)


def _horizon(study: Study, each: Asked, variants: Sequence[str]) -> Iterator[Problem]:
    where, own = f"{each.where}.horizon_s", horizons_s(study, variants)
    if each.settings.horizon_s is None and len(own) > 1:
        yield Problem(where, "missing", f"must be given: metrics.horizon_s is {' or '.join(f'{s:g}' for s in own)}")
        return
    followed_s = horizon_s(study, each.settings)
    end_s = min(scenario.run.duration_s for _, scenario in scenarios_of(study, variants))
    if followed_s >= end_s:
        allowed = f"must be less than the length of the runs, {end_s:.15g} s: no event could be followed for that long"
        yield Problem(where, f"{followed_s:.15g}", allowed)
    elif reason := too_short(MOMENTS[each.settings.metric], study, variants, followed_s):
        yield Problem(where, f"{followed_s:.15g}", reason)


def _densest(study: Study, each: Asked) -> Iterator[Problem]:
    for name, scenario in scenarios_of(study, each.variants(study)) if each.kind == RINGS else ():
        if scenario.events.density.kind == "uniform":
            allowed = f"must not be uniform for rings around the densest place; it is in {name!r}"
            yield Problem(each.where, "events.density.kind 'uniform'", allowed)
            return
