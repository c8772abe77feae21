"""The operator's configuration: how workload is measured, the arena, commands, probes, autonomy; never the truth."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from deltaswarm_scenario.operator_links import CommandSettings
from deltaswarm_scenario.page_language import LanguageSettings
from deltaswarm_scenario.radio import Place
from deltaswarm_scenario.task import TaskSettings
from deltaswarm_scenario.technique import DURING
from deltaswarm_scenario.techniques import ProbeSettings
from deltaswarm_wire.checked import OURS, Problem, SettingsError, key, rest
from deltaswarm_wire.commands import ArgumentForm, CommandForm
from deltaswarm_wire.obstacles import ObstacleSettings
from deltaswarm_wire.plugins import INBOX_POLICIES, own_settings

LEAST_BUDGET_HZ = 0.01
"""A message in 100 s."""

STRUCTURE, PRICE = "structure", "price"
OPERATOR, SWARM, SYSTEM, BUDGET = "operator", "swarm", "system", "budget"
RATE, ISA_ANSWER = "rate", "isa"


@dataclass(frozen=True)
class AutonomySettings:
    """Who sets delta. The system proposes a change, and the person at the station may veto it."""

    sets_delta: str = key(
        OPERATOR,
        "operator: the person, by orders; swarm: each agent for itself; system: a rule at the operator's console; "
        "budget: a rule there that keeps operator.threshold_hz as a budget (operator.budget), without a veto",
        choices=(OPERATOR, SWARM, SYSTEM, BUDGET),
    )
    signal: str = key(
        RATE,
        "what the rule follows: the 60 s message rate and operator.threshold_hz, or the answers to ISA",
        choices=(RATE, ISA_ANSWER),
    )
    isa_high: float = key(3.0, "ISA answer above which the person has too much to do", source=OURS, low=1, high=5)
    isa_low: float = key(3.0, "ISA answer below which delta returns to its first value", source=OURS, low=1, high=5)
    relief: float = key(
        0.5, "share of the threshold below which delta returns to its first value", source=OURS, low=0, high=1
    )
    delta_step: int = key(-1, "change of delta if there is too much to do", source=OURS, low=-100, high=100)
    delta_limit: int = key(2, "value beyond which delta is not changed", source=OURS, low=1, high=1000)
    every_s: float = key(
        60.0, "minimum time from a change, or a veto, to the next proposal [s]", source=OURS, low=0, high=1e6
    )
    veto_s: float = key(10.0, "time between a proposal and the change, for a veto; 0: none [s]", low=0, high=3600)

    @property
    def commands(self) -> bool:
        """Whether the system gives commands, so that the operator's turns are waited for."""
        return self.sets_delta in (SYSTEM, BUDGET)

    @property
    def keeps_budget(self) -> bool:
        """Whether the system keeps a budget of messages."""
        return self.sets_delta == BUDGET

    def problems(self) -> list[Problem]:
        """The rule must be able to act, and its two bounds be in order."""
        problems = []
        if not self.delta_step:
            problems.append(Problem("delta_step", "0", "must not be 0"))
        if self.isa_low > self.isa_high:
            problems.append(Problem("isa_low", f"{self.isa_low:g}", f"must be at most isa_high, {self.isa_high:g}"))
        return problems


@dataclass(frozen=True)
class BudgetSettings:
    """How the system keeps the message rate near operator.threshold_hz, by delta and by who works outside trees."""

    aim: float = key(0.9, "share of the budget that the rule aims at", source=OURS, above=0, high=1)
    every_s: float = key(30.0, "time between two orders [s]", source=OURS, above=0, high=3600)
    gain: float = key(
        0.2,
        "change of the level per order, times (aimed - measured rate) / aimed rate, which is never taken below -2",
        source=OURS,
        low=0,
        high=5,
    )
    moves: str = key(
        STRUCTURE,
        "what the rule orders: the structure, or the price of a message, for control.delta_rule learned or bandit",
        source=OURS,
        choices=(STRUCTURE, PRICE),
    )
    highest_delta: float = key(3.0, "value above which delta is not raised", source=OURS, low=2, high=1000)
    highest_rho: float = key(
        8.0, "value above which the rule does not raise rho, while free agents only walk", source=OURS, low=2, high=1000
    )
    first_level: float | None = key(
        None,
        "level that the rule starts from (default: that of control.delta); with a gain of 0 it stays there",
        source=OURS,
        low=-998,
        high=999,
    )


NO_ORDERS = ("none",)

LAYERS = ("heat", "activity", "labels", "trees")
"""Layers of the page's map that can be switched on and off."""

PANELS = ("workload", "inbox", "orders", "agents", "events", "notes", "help")
"""What the participant's page shows beside the map; help: a button that calls the conductor of the experiment."""


@dataclass(frozen=True)
class PageSettings:
    """What the page shows and offers to the person at the station."""

    title: str = key("", "heading of the page; empty: the scenario and the mode, which a participant should not read")
    end_text: str = key("", "what the page says once the run has ended; empty: that it may be closed")
    pace: bool = key(True, "whether the person may pause the run, do single steps and change its speed")
    orders: tuple[str, ...] = key(
        (),
        'orders that the page offers; an empty list: all that the controller accepts; only "none": no order',
    )
    layers: tuple[str, ...] = key(LAYERS, "layers of the map that the person may switch on", choices=LAYERS)
    panels: tuple[str, ...] = key(
        PANELS,
        "what the participant's page shows beside the map; help: a button that calls the conductor, if there is one",
        choices=PANELS,
    )
    place: tuple[int, ...] = key(
        (), "number of the run in its session, 0: training, and of all runs; the page shows it between runs", low=0
    )
    hold_while_away: bool = key(False, "whether the run is held while no page of the participant answers")
    language: LanguageSettings = key(LanguageSettings, "language of the page")


INFO, NOTICE, ALERT = SEVERITIES = ("info", "notice", "alert")

NEWS = ("new_event", "new_root", "root_lost", "unheard", "change", "repeat")
NEW_EVENT, NEW_ROOT, ROOT_LOST, UNHEARD, CHANGE, REPEAT = NEWS
"""What an item of the inbox tells; the first that applies."""

ALL = "all"


@dataclass(frozen=True)
class InboxSettings:
    """Which messages the person is shown, when and on which lines, and how much each matters."""

    policy: str = key(
        ALL,
        "all, new, grouped, ranked, limited or digest (docs/OPERATOR.md), an entry point, or module:Class",
    )
    new_event: str = key(
        ALERT, "severity of a report that names an event that was not known", source=OURS, choices=SEVERITIES
    )
    new_root: str = key(NOTICE, "severity of the first report of an agent as a root", source=OURS, choices=SEVERITIES)
    root_lost: str = key(
        ALERT,
        "severity of the report of an agent that was a root, and of the silence of a root",
        source=OURS,
        choices=SEVERITIES,
    )
    unheard: str = key(ALERT, "severity of the silence of an agent", source=OURS, choices=SEVERITIES)
    change: str = key(
        INFO, "severity of a report that tells something new of its sender alone", source=OURS, choices=SEVERITIES
    )
    repeat: str = key(INFO, "severity of a report that tells nothing new", source=OURS, choices=SEVERITIES)
    repeats: bool = key(False, "whether a report that tells nothing new is an item of the inbox too")
    unheard_s: float = key(
        0.0, "silence after which an agent that has reported is unheard [s]; 0: none is", source=OURS, low=0, high=1e6
    )
    options: dict[str, Any] = rest("the policy's own options")

    @property
    def severities(self) -> dict[str, str]:
        """Severity by what an item tells."""
        return {news: getattr(self, news) for news in NEWS}

    @property
    def own(self) -> Any:
        """The policy's own settings, from the options. Raises SettingsError."""
        return own_settings(INBOX_POLICIES, self.policy, self.options, "", "policy")

    def problems(self) -> list[Problem]:
        """The policy must exist, and take its options."""
        if self.policy == ALL and not self.options:
            return []  # nobody need import it
        try:
            _ = self.own
        except SettingsError as error:
            return error.problems
        return []


OFF, NONE, THRESHOLD = "off", "none", "threshold"
POLICIES = (OFF, NONE, THRESHOLD)
NEW_FIRST, LISTED = "new", "listed"

SET_DELTA, DELTA = "set delta", "delta"
"""The command that changes delta, and its argument; a controller may accept it."""

SET_STRUCTURE = "set structure"
"""The command that changes delta in small steps, and the share of agents that work outside trees."""

SET_PRICE, MESSAGE_PRICE = "set price", "message_price"
"""The command that changes what a message is worth to agents with a learned rule, and its argument."""

DELTA_RULE, PRICED = "delta_rule", ("learned", "bandit")
"""The controller's option that says that they have one, and which these are."""


@dataclass(frozen=True)
class PersonSettings:
    """A simulated person at the operator's console; what each key stands for is in docs/OPERATOR.md."""

    policy: str = key(
        OFF,
        "off: nobody is simulated; none: reads and commands nothing; threshold: changes delta by the message rate",
        choices=POLICIES,
    )
    reads: str = key(
        NEW_FIRST,
        "which line of the inbox is read next. new: the oldest new one, seen at a glance; listed: the oldest or, with "
        "operator.inbox.policy ranked, the most severe",
        source=OURS,
        choices=(NEW_FIRST, LISTED),
    )
    known_s: float = key(
        1.0, "median time for an item that names nothing new, at best load [s]", source=OURS, above=0, high=3600
    )
    new_s: float = key(4.0, "median time for a new event or root, at best load [s]", source=OURS, above=0, high=3600)
    more_s: float = key(
        0.5, "median time for each further item on a line of the inbox, at best load [s]", source=OURS, low=0, high=3600
    )
    command_s: float = key(6.0, "median time to give a command, at best load [s]", source=OURS, above=0, high=3600)
    sigma: float = key(0.5, "spread of these times: sigma of a lognormal distribution", source=OURS, low=0, high=3)
    memory_s: float = key(
        300.0, "time constant of the load, a moving average of being busy [s]", source=OURS, above=0, high=1e6
    )
    best_load: float = key(0.55, "load, from 0 to 1, at which work is fastest", source=OURS, low=0, high=0.95)
    slowing: float = key(0.5, "share by which full load slows all work", source=OURS, low=0, high=10)
    patience_s: float = key(60.0, "time after which an unread item is missed [s]", source=OURS, above=0, high=1e6)
    command_every_s: float = key(
        60.0, "minimum time between two commands, in which the swarm settles [s]", source=OURS, low=0, high=1e6
    )
    delta_step: int = key(
        -1,
        "change of delta while the 60 s message rate is above operator.threshold_hz",
        source=OURS,
        low=-100,
        high=100,
    )
    delta_limit: int = key(2, "value beyond which delta is not changed", source=OURS, low=1, high=1000)
    relief: float = key(
        0.5, "share of the threshold below which delta returns towards its first value", source=OURS, low=0, high=1
    )

    @property
    def is_on(self) -> bool:
        """Whether there is a simulated person."""
        return self.policy != OFF

    @property
    def commands(self) -> bool:
        """Whether the person may give commands, so that its turns are waited for."""
        return self.policy == THRESHOLD

    def problems(self) -> list[Problem]:
        """A policy must be able to act."""
        if self.commands and not self.delta_step:
            return [Problem("delta_step", "0", "must not be 0 with the policy 'threshold'")]
        return []


@dataclass(frozen=True)
class OperatorSettings:
    """How the workload is measured, and who the operator is."""

    threshold_hz: float = key(5.0, "message rate, over the last 60 s, above which time is counted", low=0)
    more_thresholds_hz: tuple[float, ...] = key((), "further thresholds that the station shows", low=0)
    probes: ProbeSettings = key(ProbeSettings, "what a person at the station is asked")
    page: PageSettings = key(PageSettings, "what the station's page shows and offers")
    inbox: InboxSettings = key(InboxSettings, "which messages the person is shown, and when")
    person: PersonSettings = key(PersonSettings, "a simulated person at the console")
    autonomy: AutonomySettings = key(AutonomySettings, "who sets delta during the run")
    budget: BudgetSettings = key(BudgetSettings, "how the system keeps a message budget")
    task: TaskSettings = key(TaskSettings, "the person's task: to tell targets from decoys")

    @property
    def commands(self) -> bool:
        """Whether a simulated person or the system may give commands, so that the operator's turns are waited for."""
        return self.person.commands or self.autonomy.commands

    @property
    def asks_in_passing(self) -> bool:
        """Whether the person is asked anything while the run goes on."""
        asked = any(one.when == DURING and one.wait_s is not None for one in self.probes.techniques)
        return asked or self.autonomy.sets_delta == SYSTEM

    def problems(self) -> list[Problem]:
        """A budget must leave room for a message."""
        if self.autonomy.keeps_budget and self.threshold_hz < LEAST_BUDGET_HZ:
            allowed = f"must be at least {LEAST_BUDGET_HZ:g} with autonomy.sets_delta = 'budget'"
            return [Problem("threshold_hz", f"{self.threshold_hz:g}", allowed)]
        return []


@dataclass(frozen=True)
class Briefing:
    """The operator's configuration for a run in which a person, a script or a simulation watches or commands."""

    title: str = key("", "what the station calls the run")
    mode: str = key("", "control mode of the agents")
    seed: int = key(0, "for the operator's own randomness", low=0, high=2**63 - 1)
    duration_s: float = key(0.0, "simulated time of the run [s]")
    step_s: float = key(1.0, "length of a step [s]")
    width_m: float = key(100.0, "arena along x [m]")
    height_m: float = key(100.0, "arena along y [m]")
    obstacles: tuple[ObstacleSettings, ...] = key((), "what bodies do not enter")
    base_m: Place | None = key(None, "where the operator's base is [m]", length=2)
    range_m: float | None = key(None, "reports are heard up to here from the base [m]")
    agents: int = key(1, "number of agents")
    radius_m: float = key(0.0, "radius of an agent's body; 0: a point [m]")
    operator: OperatorSettings = key(OperatorSettings, "how workload is measured")
    forms: tuple[CommandForm, ...] = key((), "the commands that the controller accepts")
    command: tuple[CommandSettings, ...] = key((), "what a scripted operator commands")
    speed: float = key(1.0, "simulated per wall second to begin with; 0: as fast as possible", low=0)

    @property
    def is_awaited(self) -> bool:
        """Whether each step waits for the operator's turn."""
        return bool(self.command) or self.operator.commands

    @property
    def offered(self) -> tuple[CommandForm, ...]:
        """The orders that the person at the station may give."""
        operator = self.operator
        names = operator.page.orders or [form.name for form in self.forms]
        withheld = [SET_DELTA, SET_STRUCTURE] if operator.autonomy.sets_delta != OPERATOR else []
        withheld += [SET_PRICE] if operator.autonomy.commands else []
        return tuple(form for form in self.forms if form.name in names and form.name not in withheld)


def begun_with(forms: tuple[CommandForm, ...], options: Mapping[str, Any]) -> tuple[CommandForm, ...]:
    """Forms whose arguments begin with the controller's own options, where they have the same name.

    Without those that the options rule out.
    """
    ruled_out = () if options.get(DELTA_RULE) in PRICED else (SET_PRICE,)
    numbers = {name: float(value) for name, value in options.items() if type(value) in (int, float)}

    def begun(argument: ArgumentForm) -> ArgumentForm:
        return replace(argument, default=numbers.get(argument.name, argument.default))

    return tuple(
        replace(form, arguments=tuple(map(begun, form.arguments))) for form in forms if form.name not in ruled_out
    )
