"""Reconfigure a console during a run: new settings, new script. Pure."""

from collections.abc import Iterable

from deltaswarm_operator.core.autonomy import autonomy_of
from deltaswarm_operator.core.budget import Price, Structure, budget_of
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.script import Script, Scripted
from deltaswarm_operator.core.simulated_operator import person_of
from deltaswarm_operator.inbox.policy import RANKED
from deltaswarm_scenario.operator_settings import (
    DELTA,
    MESSAGE_PRICE,
    SET_DELTA,
    SET_PRICE,
    SET_STRUCTURE,
    Briefing,
)
from deltaswarm_scenario.person_tables import SYSTEM
from deltaswarm_wire.commands import ALL

STRUCTURES, WORKING = (SET_DELTA, SET_STRUCTURE), "working"
"""The commands that set delta, and the argument with the share of agents that work outside trees."""


def reconfigure(console: Console, briefing: Briefing, commands: Iterable[Scripted], rule_drops: int = 0) -> None:
    """Continue a console with other settings and another script; what it knows, and work under way, stay.

    Args:
        console: the console, between two steps.
        briefing: the settings from now on.
        commands: the script from now on.
        rule_drops: number of next commands of a simulated person or of the system that are left out; both act as if
            they had been given.
    """
    before, now = console.briefing.operator, briefing.operator
    given = console.command_log.next
    waiting = (scripted for scripted in commands if scripted.number is None or scripted.number >= given)
    console.go_on_with(briefing, Script(waiting, briefing.step_s), rule_drops)
    structure = _ordered(console)
    person, is_ranked = console.person, console.ledger.order == RANKED
    if person is None or not now.person.is_on:
        person = person_of(briefing, is_ranked=is_ranked)
        if person is not None and structure is not None:
            person.delta = round(structure.delta)
    else:
        person.go_on_with(now.person, now.threshold_hz, is_ranked=is_ranked)
    autonomy = console.autonomy
    if now.autonomy != before.autonomy:
        autonomy = autonomy_of(briefing)
        if autonomy is not None and structure is not None:
            autonomy.delta = round(structure.delta)
    elif autonomy is not None:
        autonomy.threshold_hz = now.threshold_hz
    budget = console.budget
    if (now.autonomy, now.budget) != (before.autonomy, before.budget):
        budget = budget_of(briefing)
        if budget is not None:
            by_rule_s = [sent.sent_s for sent in console.command_log.sent if sent.by == SYSTEM]
            budget.ordered_s = by_rule_s[-1] if by_rule_s else console.picture.now_s
            budget.structure = _taken_over(console, budget.structure, structure)
    elif budget is not None:
        budget.budget_hz = now.threshold_hz
    console.set_rules(person, autonomy, budget)


def _taken_over(console: Console, first: Structure | Price, structure: Structure | None) -> Structure | Price:
    """Return what a rule goes on from that would begin with `first`: of its kind, what all agents were ordered last."""
    if isinstance(first, Structure):
        return structure or first
    given = [sent.command for sent in console.command_log.sent]
    prices = [command.arguments[MESSAGE_PRICE] for command in given if command.name == SET_PRICE]
    return Price(float(prices[-1])) if prices else first


def _ordered(console: Console) -> Structure | None:
    """Return the structure that all agents were last ordered to take; None if there was no such command."""
    given = [sent.command for sent in console.command_log.sent]
    about = [command.arguments for command in given if command.name in STRUCTURES and command.target.kind == ALL]
    shares = [float(arguments[WORKING]) for arguments in about if WORKING in arguments]  # set delta leaves the share
    return Structure(float(about[-1][DELTA]), shares[-1] if shares else 1.0) if about else None
