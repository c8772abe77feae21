"""Situation questions whose answer is nearly always the same in a condition."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.operator_settings import NONE
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.situation import OR, AtTimes, known
from deltaswarm_sessions.plan import PlannedRun

ALWAYS = 0.9
"""Share of moments from which on an answer counts as given away."""


def asked(scenario: Scenario) -> dict[str, tuple[str, ...]]:
    """Return the questions about the situation that a run asks, by technique."""
    asking = [one for one in scenario.operator.probes.techniques if isinstance(one, AtTimes)]
    return {one.name: tuple(question.name for question in one.questions) for one in asking}


def situation_warnings(planned: Iterable[PlannedRun]) -> list[str]:
    """Return warnings about questions whose answers a condition gives away, or that conditions do not share.

    Each condition is run in one process without a person, and the answers are those that its page would have shown.
    """
    conditions = {run.label: run.scenario for run in planned if run.position}
    warnings = [warning for label, scenario in conditions.items() for warning in _given_away(label, scenario)]
    different = {label: tuple(sorted(asked(scenario).items())) for label, scenario in conditions.items()}
    if len(set(different.values())) > 1:
        told = "; ".join(f"{label}: {_words(scenario)}" for label, scenario in conditions.items())
        warnings.append(
            f"the conditions ask different questions about the situation, whose shares differ for it ({told})"
        )
    return warnings


def _words(scenario: Scenario) -> str:
    return ", ".join(f"{name} {', '.join(items)}" for name, items in asked(scenario).items()) or "none"


def _given_away(label: str, scenario: Scenario) -> list[str]:
    warnings = []
    if scenario.operator.task.is_on and not 1 - ALWAYS < (share := scenario.operator.task.target_share) < ALWAYS:
        warnings.append(f"condition {label} gives away the judgements: {share:.0%} of its events are targets")
    return warnings + _known_beforehand(label, scenario)


def _known_beforehand(label: str, scenario: Scenario) -> list[str]:
    items = sorted({item for items in asked(scenario).values() for item in items})
    if not items:
        return []
    counts: dict[str, Counter[str]] = {item: Counter() for item in items}
    person = replace(scenario.operator.person, policy=NONE)
    swarm = InProcess(replace(scenario, record="off", operator=replace(scenario.operator, person=person)))
    assert swarm.console is not None
    probes = scenario.operator.probes
    first_s = min([*probes.sagat_at_s, *probes.spam_at_s, probes.situation_first_s])
    steps = 0
    for record, _ in swarm.steps():
        if record.time_s >= first_s:
            steps += 1
            seen = swarm.console.see()
            for item in items:
                if OR not in (answer := known(item, seen)):  # else it is not asked
                    counts[item][answer] += 1
    return [
        f"condition {label}{' gives away the answer' if count >= ALWAYS * total else ''}: chance level of {item} is "
        f"{count / total:.0%}, by always answering {answer}; asked at {total / steps:.0%} of the moments"
        for item in items
        for answer, count in counts[item].most_common(1)
        if (total := counts[item].total())
    ]
