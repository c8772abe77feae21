"""The rule that keeps a budget of messages by the swarm's control structure. Pure; all times are simulated [s].

One level says how much of the swarm may report by itself. Up to level 0 free agents only walk, and an agent founds a
tree at 2 - level events. From 0 to 1 an agent founds one at 2, and this share of the agents works outside trees. From 1
on all do, and delta is level + 1. The rule raises the level while fewer messages arrive than the budget allows, and
lowers it while more do, in proportion to the difference.

Where agents choose delta by the price of a message, the rule can order that price instead: e to the power of minus the
level.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from deltaswarm_operator.core.autonomy import first_delta, first_of
from deltaswarm_scenario.operator_settings import (
    MESSAGE_PRICE,
    PRICE,
    SET_PRICE,
    SET_STRUCTURE,
    Briefing,
    BudgetSettings,
)

LEAST_DELTA = 2.0
"""With a delta of 1 each event would make a root, and more roots send more messages (Sensitivity to delta)."""


MOST_LEVEL = 3.0
"""Prices are from 0.05 to 20 s, those that policies are trained on."""


class Structure(NamedTuple):
    """How much of a swarm is centralised: delta, and the share of the agents that work outside trees."""

    delta: float
    working: float

    @property
    def level(self) -> float:
        """The level at which the rule orders this structure, or one like it."""
        if self.working >= 1:
            return max(self.delta, LEAST_DELTA) - 1
        return self.working or LEAST_DELTA - self.delta


def structure_at(level: float) -> Structure:
    """Return the structure at a level, to hundredths."""
    delta = level + 1 if level > 1 else LEAST_DELTA - min(level, 0.0)
    return Structure(round(delta, 2), round(min(1.0, max(0.0, level)), 2))


class Price(NamedTuple):
    """What a message is worth to agents that choose delta by it [s]."""

    message_price: float

    @property
    def level(self) -> float:
        """The level at which the rule orders this price, or one near it."""
        return -math.log(min(max(self.message_price, math.exp(-MOST_LEVEL)), math.exp(MOST_LEVEL)))


def price_at(level: float) -> Price:
    """Return the price at a level, to thousandths."""
    return Price(round(math.exp(-min(MOST_LEVEL, max(-MOST_LEVEL, level))), 3))


@dataclass
class Budget:
    """The rule in one run.

    Args:
        settings: the rule's parameters.
        budget_hz: the message rate to keep [1/s].
        structure: what the swarm has, of what the rule orders.
        ordered_s: when it was ordered [s].
    """

    settings: BudgetSettings
    budget_hz: float
    structure: Structure | Price
    ordered_s: float = 0.0

    @property
    def command(self) -> str:
        """The command that the rule gives."""
        return SET_PRICE if isinstance(self.structure, Price) else SET_STRUCTURE

    def order(self, now_s: float, rate_hz: float) -> Structure | Price | None:
        """Return the structure or the price to order now, at a message rate [1/s], or None.

        It is ordered at each interval, whether it has changed or not, since agents may not have heard the last order.
        """
        settings = self.settings
        due_s = self.ordered_s + settings.every_s
        if now_s < due_s - 1e-9:
            return None
        self.ordered_s = due_s if due_s + settings.every_s > now_s else now_s
        level, aim_hz = self.structure.level, settings.aim * self.budget_hz
        room = max(-2.0, (aim_hz - rate_hz) / aim_hz)
        if isinstance(self.structure, Price):
            self.structure = price_at(level + settings.gain * room)
            return self.structure
        # A level beyond its bound goes no further, but need not come back at once.
        highest, lowest = max(settings.highest_delta - 1, level), min(LEAST_DELTA - settings.highest_rho, level)
        self.structure = structure_at(max(lowest, min(highest, level + settings.gain * room)))
        return self.structure


def budget_of(briefing: Briefing) -> Budget | None:
    operator, delta = briefing.operator, first_delta(briefing)
    if not operator.autonomy.keeps_budget or delta is None:
        return None
    price = first_of(briefing, SET_PRICE, MESSAGE_PRICE) if operator.budget.moves == PRICE else None
    level = operator.budget.first_level
    first = Structure(float(delta), 1.0) if level is None else structure_at(level)
    return Budget(operator.budget, operator.threshold_hz, first if price is None else Price(price))
