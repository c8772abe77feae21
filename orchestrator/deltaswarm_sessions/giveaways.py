"""What a condition gives away: questions about the situation to which one answer is nearly always right."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.operator_settings import NONE
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_scenario.situation import SAGAT, SPAM, known
from deltaswarm_sessions.plan import PlannedRun

ALWAYS = 0.9
"""Share of moments from which on an answer counts as given away."""


def asked(scenario: Scenario) -> dict[str, tuple[str, ...]]:
    """Return the questions about the situation that a run asks, by technique."""
    probes = scenario.operator.probes
    questions = {SAGAT: probes.sagat_questions, SPAM: probes.spam_questions}
    return {one.name: questions[one.name] for one in probes.techniques if one.name in questions}


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
    for record, _ in swarm.steps():
        if record.time_s >= first_s:
            seen = swarm.console.see()
            for item in items:
                counts[item][known(item, seen)] += 1
    return [
        f"condition {label} gives away the answer to {item}: {answer} is right at {count / total:.0%} of its moments"
        for item in items
        for answer, count in counts[item].most_common(1)
        if count >= ALWAYS * (total := counts[item].total())
    ]
