"""Let a console go on by other settings and another script, in the middle of a run. Pure."""

from collections.abc import Iterable

from deltaswarm_operator.core.autonomy import autonomy_of
from deltaswarm_operator.core.budget import Structure, budget_of
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.script import Script, Scripted
from deltaswarm_operator.core.simulated_operator import person_of
from deltaswarm_operator.inbox.policy import RANKED
from deltaswarm_scenario.operator_settings import DELTA, SET_DELTA, SET_STRUCTURE, Briefing
from deltaswarm_scenario.person_tables import SYSTEM
from deltaswarm_wire.commands import ALL

STRUCTURES, WORKING = (SET_DELTA, SET_STRUCTURE), "working"
"""The commands that set delta, and the argument with the share of agents that work outside trees."""


def go_on_with(console: Console, briefing: Briefing, commands: Iterable[Scripted], rule_drops: int = 0) -> None:
    """Let a console go on by other settings and by another script. What it knows stays, and so does what is under way.

    Args:
        console: the console, between two steps.
        briefing: the settings from now on.
        commands: the script from now on.
        rule_drops: so many of the next commands of a simulated person or of the system are not given, though these
            take them for given.
    """
    before, now = console.briefing.operator, briefing.operator
    console.briefing, console.command_log.forms = briefing, briefing.forms
    given = console.command_log.next
    waiting = (scripted for scripted in commands if scripted.number is None or scripted.number >= given)
    console.script, console.rule_drops = Script(waiting, briefing.step_s), rule_drops
    if now.inbox != before.inbox:
        console.picture.go_on_with(now.inbox)
        console.ledger.go_on_with(now.inbox, now.person.patience_s)
    structure = _ordered(console)
    person = console.person
    if person is None or not now.person.is_on:
        console.person = person_of(briefing, is_ranked=console.ledger.order == RANKED)
        if console.person is not None and structure is not None:
            console.person.delta = round(structure.delta)
    else:
        person.go_on_with(now.person, now.threshold_hz, is_ranked=console.ledger.order == RANKED)
    if now.autonomy != before.autonomy:
        console.autonomy = autonomy_of(briefing)
        if console.autonomy is not None and structure is not None:
            console.autonomy.delta = round(structure.delta)
    elif console.autonomy is not None:
        console.autonomy.threshold_hz = now.threshold_hz
    if (now.autonomy, now.budget) != (before.autonomy, before.budget):
        console.budget = budget_of(briefing)
        if console.budget is not None:
            by_rule_s = [sent.sent_s for sent in console.command_log.sent if sent.by == SYSTEM]
            console.budget.ordered_s = by_rule_s[-1] if by_rule_s else console.picture.now_s
            console.budget.structure = structure or console.budget.structure
    elif console.budget is not None:
        console.budget.budget_hz = now.threshold_hz


def _ordered(console: Console) -> Structure | None:
    """Return the structure that all agents were ordered last; None if there was no such command."""
    given = [sent.command for sent in console.command_log.sent]
    about = [command.arguments for command in given if command.name in STRUCTURES and command.target.kind == ALL]
    shares = [float(arguments[WORKING]) for arguments in about if WORKING in arguments]  # set delta leaves the share
    return Structure(float(about[-1][DELTA]), shares[-1] if shares else 1.0) if about else None
