"""What a branch does differently, and in which step: checked against its parent. Pure, but for loading settings."""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from deltaswarm_branches.keys import DECIDED, DROPPED, KEPT, problem_of
from deltaswarm_branches.parent import Order, Parent
from deltaswarm_orchestrator.base import inputs
from deltaswarm_orchestrator.base.frozen import changed_keys
from deltaswarm_orchestrator.base.inputs import Inputs
from deltaswarm_orchestrator.run.engine import Turn
from deltaswarm_orchestrator.run.in_process import InProcess, Scripted
from deltaswarm_orchestrator.run.randomness import Randomness
from deltaswarm_orchestrator.scenarios.load import apply, check_table
from deltaswarm_scenario.operator_links import FIRST_STEP, CommandSettings
from deltaswarm_scenario.operator_settings import NONE, OPERATOR, OperatorSettings
from deltaswarm_scenario.person_tables import SCRIPT
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.checked import Problem, SettingsError, check, plain
from deltaswarm_wire.commands import forms_of, named
from deltaswarm_wire.plugins import find_controller

BUDGET_KEYS = "operator.budget"
RULES = ("operator.person", "operator.autonomy", BUDGET_KEYS)
"""Keys of what gives orders by a rule."""


@dataclass(frozen=True)
class Difference:
    """What a branch does differently from its parent."""

    drop: tuple[int, ...] = ()
    """Numbers of orders that are not given."""
    add: tuple[CommandSettings, ...] = ()
    """Orders that are given besides."""
    sets: tuple[str, ...] = ()
    """`key=value` of settings that hold from then on."""
    later: str = ""
    """One of LATER; empty: decided where a rule gives orders, else kept."""

    @property
    def told(self) -> dict[str, Any]:
        """The difference for JSON and TOML, without what does not differ."""
        told = {"drop_commands": list(self.drop), "add_commands": list(map(plain, self.add)), "set": list(self.sets)}
        return {name: value for name, value in told.items() if value}

    @property
    def text(self) -> str:
        """The difference in words."""
        parts = [f"without order {number}" for number in self.drop]
        parts += [f"with {command.name!r} at {command.at_s:g} s" for command in self.add]
        return ", ".join([*parts, *self.sets]) or "no difference"


@dataclass(frozen=True)
class Plan:
    """A branch, by its steps."""

    at_step: int
    """The first step in which the world can differ."""
    scenario: Scenario
    """What holds from then on."""
    commands: tuple[Scripted, ...]
    """The script from then on."""
    rule_drops: int
    """So many of the next orders of the rule are not sent."""
    later: str
    """One of LATER."""
    changes_console: bool
    restarts_agents: bool
    inputs: Inputs
    """The files that decide the branch, as they were when it was planned."""

    def check_inputs(self) -> None:
        """Check that these files are as they were. Raises InputsChangedError."""
        inputs.check(self.scenario, self.inputs, starts_python=False)

    @property
    def turn_step(self) -> int:
        """The step at whose end the operator decides what leaves the base in `at_step`."""
        return max(0, self.at_step - FIRST_STEP)

    def turn(self, randomness: Randomness | None) -> Turn:
        """Return the turn of a run from the beginning into this branch, whose agents start nowhere anew."""
        console = (self.commands, self.rule_drops) if self.changes_console else None
        return Turn(self.turn_step, self.at_step, self.scenario, console, randomness)

    def before(self, swarm: InProcess, step: int, seed: int | None = None) -> None:
        """Before a step, make the difference that is due. With a seed, agents that start anew draw by it."""
        if step == self.turn_step and self.changes_console:
            swarm.go_on_with(self.scenario, self.commands, self.rule_drops)
        if step == self.at_step and self.restarts_agents:
            swarm.restart(step, seed)


def at_step(parent: Parent, at_s: float | None, drop: Sequence[int]) -> int:
    """Return the step of a branching point: at a time [s], or where the first dropped order leaves.

    Raises:
        SettingsError: there is no such step.
    """
    if at_s is None:
        if not drop:
            raise SettingsError([Problem("--at", "nothing", "must be given without --drop-command")])
        if unknown := list(_unknown(parent, drop)):
            raise SettingsError(unknown)
        return min(order.step for order in parent.orders if order.number in drop)
    step, end_s = round(at_s / parent.step_s), parent.steps * parent.step_s
    if not 1 <= step < parent.steps:
        must = f"must be after the first step and before the end, from {parent.step_s:g} to {end_s - parent.step_s:g} s"
        raise SettingsError([Problem("--at", f"{at_s:.15g}", must)])
    return step


def plan(parent: Parent, step: int, difference: Difference) -> Plan:
    """Check a difference, and work out what a branch does from a step on.

    Raises:
        SettingsError: a part of the difference has no meaning; all mistakes are named.
    """
    table = plain(parent.scenario)
    if problems := [problem for text in difference.sets for problem in _set(table, text)]:
        raise SettingsError(problems)
    restarts = table["control"] != plain(parent.scenario)["control"]
    operator, _ = check(OperatorSettings, table["operator"])  # None if it is wrong, which `check_table` says
    has_rule = operator is not None and operator.commands
    later = difference.later or (DECIDED if has_rule or parent.has_rule else KEPT)
    problems = [
        *_rule_problems(parent, operator, difference, later),
        *_drop_problems(parent, step, difference, later),
        *_add_problems(parent, step, difference.add),
    ]
    is_rule_muted = has_rule and later != DECIDED
    if is_rule_muted:
        table["operator"]["person"]["policy"] = NONE if parent.scenario.operator.person.is_on else "off"
        table["operator"]["autonomy"]["sets_delta"] = OPERATOR
    by_script = [order for order in parent.orders if later != DECIDED or order.by == SCRIPT]
    script = [
        *(
            Scripted(_leaving(order, parent.step_s), later == DROPPED or order.number in difference.drop, order.number)
            for order in by_script
            if order.step >= step
        ),
        *map(Scripted, difference.add),
    ]
    past = _accepted([order.command for order in by_script if order.step < step], table)
    commands = past + [scripted.command for scripted in script if not scripted.is_dropped]
    scenario = _scenario(parent, table, commands, difference, problems)
    changes_orders = is_rule_muted or later == DROPPED or bool(difference.drop or difference.add)
    changes_console = changes_orders or restarts or scenario.operator != parent.scenario.operator
    return Plan(
        step,
        scenario if changes_console else parent.scenario,
        tuple(script),
        _dropped_of_rule(parent, difference) if later == DECIDED else 0,
        later,
        changes_console,
        restarts,
        inputs.identify(scenario if changes_console else parent.scenario),
    )


def _rule_problems(
    parent: Parent, operator: OperatorSettings | None, difference: Difference, later: str
) -> Iterator[Problem]:
    """Yield what is wrong about rules that give orders: none is there, or it gives none."""
    if operator is not None and not operator.autonomy.keeps_budget:
        allowed = "must be given with operator.autonomy.sets_delta = 'budget': no rule keeps a budget in this branch"
        yield from (Problem("--set", text, allowed) for text in difference.sets if text.startswith(BUDGET_KEYS))
    has_rule = operator is not None and operator.commands
    if later == DECIDED and not (has_rule or parent.has_rule):
        yield Problem("--later", DECIDED, "must be kept or dropped: no rule gives orders in this run")
    if has_rule and later != DECIDED:
        allowed = f"must be given without --later {later}: no rule decides"
        yield from (Problem("--set", text, allowed) for text in difference.sets if text.startswith(RULES))


def _dropped_of_rule(parent: Parent, difference: Difference) -> int:
    return sum(order.by != SCRIPT for order in parent.orders if order.number in difference.drop)


def _scenario(
    parent: Parent,
    table: dict[str, Any],
    commands: Sequence[CommandSettings],
    difference: Difference,
    problems: list[Problem],
) -> Scenario:
    """Return the scenario of a branch. Raises SettingsError, with `problems` too."""
    table["command"] = [plain(command) for command in commands]
    scenario, wrong = check_table(table)
    if scenario is not None:
        others = changed_keys(plain(parent.scenario) | {"command": table["command"]}, plain(scenario))
        problems += [problem for key in others if (problem := problem_of(key))]
    if scenario is None or problems + wrong:
        raise SettingsError([*problems, *_in_words(wrong, commands, difference.add)])
    return scenario


def _set(table: dict[str, Any], text: str) -> list[Problem]:
    """Set a key of a scenario's table; another mode keeps the options that its controller has."""
    key = text.partition("=")[0].strip()
    if problem := problem_of(key):
        return [problem]
    if key == "control.mode" and "=" in text:
        control, mode = table["control"], text.partition("=")[2].strip().strip("\"'")
        options = {field.name for field in dataclasses.fields(find_controller(mode, "--mode").Settings)}
        table["control"] = {name: value for name, value in control.items() if name == "mode" or name in options}
    return apply(table, text)


def _accepted(commands: Sequence[CommandSettings], table: dict[str, Any]) -> list[CommandSettings]:
    """Return those of some commands that the controller of a scenario's table accepts; another mode may not."""
    forms = forms_of(find_controller(table["control"]["mode"]))
    return [
        command
        for command in commands
        if (form := named(forms, command.name)) and not form.problem(command.command(0).target, command.arguments)
    ]


def _leaving(order: Order, step_s: float) -> CommandSettings:
    return dataclasses.replace(order.command, at_s=order.step * step_s)


def _drop_problems(parent: Parent, step: int, difference: Difference, later: str) -> Iterator[Problem]:
    """Yield what is wrong with the orders to drop."""
    by_number = {order.number: order for order in parent.orders}
    yield from _unknown(parent, difference.drop)
    ruled = [order for order in parent.orders if order.step >= step and order.by != SCRIPT]
    is_alone = not (difference.add or difference.sets)
    for number in by_number.keys() & set(difference.drop):
        order = by_number[number]
        if order.step < step:
            left_s = order.step * parent.step_s
            yield Problem(
                "--drop-command", str(number), f"must leave the base at or after --at (it left at {left_s:g} s)"
            )
        elif parent.digest is None and parent.has_rule:
            yield Problem("--drop-command", str(number), "must be of a run that has ended: this one was killed")
        elif later == DECIDED and order.by != SCRIPT and not (order is ruled[0] and (order.step == step or is_alone)):
            must = f"must be the first order from --at on, number {ruled[0].number}, since later ones are decided anew"
            yield Problem("--drop-command", str(number), f"{must}; or --later {KEPT}")
    if len(set(difference.drop)) < len(difference.drop):
        yield Problem("--drop-command", ", ".join(map(str, difference.drop)), "must name each order once")


def _unknown(parent: Parent, drop: Sequence[int]) -> Iterator[Problem]:
    """Yield the orders to drop that were never given."""
    known = [order.number for order in parent.orders]
    for number in drop:
        if number not in known:
            which = f"0 to {known[-1]}" if known else "this run gave none"
            yield Problem("--drop-command", str(number), f"must be an order that left the base: {which}")


def _add_problems(parent: Parent, step: int, added: Sequence[CommandSettings]) -> Iterator[Problem]:
    """Yield what is wrong with the times of added orders."""
    first_s = max(step, FIRST_STEP) * parent.step_s
    last_s = (parent.steps - 1) * parent.step_s
    for command in added:
        if not first_s - 1e-9 <= command.at_s <= last_s + 1e-9:
            must = f"must be from {first_s:g} s, at or after --at, to {last_s:g} s"
            yield Problem("--add-command at_s", f"{command.at_s:.15g}", must)


def _in_words(
    problems: Sequence[Problem], given: Sequence[CommandSettings], added: Sequence[CommandSettings]
) -> Iterator[Problem]:
    """Yield problems with settings; those about orders name the order by its time."""
    for problem in problems:
        place, _, _ = problem.path.removeprefix("command[").partition("]")
        if not (problem.path.startswith("command[") and place.isdecimal()):
            yield problem
            continue
        command = given[int(place)]
        path = "--add-command" if command in added else f"the order {command.name!r} at {command.at_s:g} s"
        or_else = "" if command in added else f"; or --later {DROPPED}"
        yield dataclasses.replace(problem, path=path, allowed=f"{problem.allowed}{or_else}")
