"""The rule that keeps a budget of messages by the swarm's control structure. Pure; all times are simulated [s].

Two hands turn the paper's knob. The quick one sets which share of the agents works outside trees, where each reports by
itself. The slow one sets delta, so that few agents have to be taken off: while more are, trees must form sooner, since
they bundle reports; while none is, they may form later, since events then complete sooner.
"""

from dataclasses import dataclass, field
from math import exp
from typing import NamedTuple

from deltaswarm_operator.core.autonomy import first_delta
from deltaswarm_scenario.operator_settings import Briefing, BudgetSettings

LEAST_DELTA = 2.0
"""With a delta of 1 each event would make a root, and more roots send more messages (Sensitivity to delta)."""

LEAST_WORKING = 0.02
"""From less than this the quick hand would take too long to come back."""


class Structure(NamedTuple):
    """How much of a swarm is centralised: delta, and the share of the agents that work outside trees."""

    delta: float
    working: float


@dataclass
class Budget:
    """The rule in one run.

    Args:
        settings: the rule's parameters.
        budget_hz: the message rate to keep below [1/s].
        step_s: length of a step [s].
        structure: what the swarm begins with.
    """

    settings: BudgetSettings
    budget_hz: float
    step_s: float
    structure: Structure
    rate_hz: float = field(init=False)
    """The measured message rate, averaged with weights that decline by `average_s` [1/s]."""
    _ordered: Structure = field(init=False)
    _ordered_s: float = 0.0

    def __post_init__(self) -> None:
        self.rate_hz = self._aim_hz
        self._ordered = self.structure

    @property
    def _aim_hz(self) -> float:
        return self.settings.aim * self.budget_hz

    def close_step(self, now_s: float, rate_hz: float) -> Structure | None:
        """Take in a step's message rate [1/s]; return the structure to order now, or None."""
        self.rate_hz += (rate_hz - self.rate_hz) * (1 - exp(-self.step_s / self.settings.average_s))
        passed_s = now_s - self._ordered_s
        if passed_s < self.settings.every_s:
            return None
        self._ordered_s = now_s
        self.structure = self._next(passed_s)
        order = Structure(*(round(value, 2) for value in self.structure))
        if order == self._ordered:
            return None
        self._ordered = order
        return order

    def _next(self, passed_s: float) -> Structure:
        settings = self.settings
        room = self._aim_hz / max(self.rate_hz, 0.2 * self._aim_hz)
        working = min(1.0, max(LEAST_WORKING, self.structure.working * room**settings.gain))
        change = settings.delta_per_min * (settings.taken_off - (1 - working)) * passed_s / 60
        return Structure(min(settings.highest_delta, max(LEAST_DELTA, self.structure.delta + change)), working)


def budget_of(briefing: Briefing) -> Budget | None:
    """Make the rule that keeps a message budget, if a briefing asks for it."""
    operator, delta = briefing.operator, first_delta(briefing)
    if not operator.autonomy.keeps_budget or delta is None:
        return None
    return Budget(operator.budget, operator.threshold_hz, briefing.step_s, Structure(float(delta), 1.0))
