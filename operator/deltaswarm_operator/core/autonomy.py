"""The rule by which the system sets delta, with the person's veto. Pure; all times are simulated [s]."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from deltaswarm_scenario.operator_settings import DELTA, ISA_ANSWER, SET_DELTA, SYSTEM, AutonomySettings, Briefing
from deltaswarm_wire.commands import named


def next_delta(delta: int, first: int, *, is_high: bool, is_low: bool, step: int, limit: int) -> int | None:
    """Return the delta that follows: a step towards the limit, or back towards the first value; None: as it is."""
    if is_high:
        goal = limit
    elif is_low:
        goal, step = first, -step
    else:
        return None
    left = goal - delta
    if left * step <= 0:
        return None
    return delta + (step if abs(step) < abs(left) else left)


class Proposal(NamedTuple):
    delta: int
    due_s: float


@dataclass
class Autonomy:
    """The system's rule for one run.

    Args:
        settings: the rule's parameters.
        threshold_hz: the message rate to stay below [1/s].
        delta: the swarm's initial delta.
    """

    settings: AutonomySettings
    threshold_hz: float
    delta: int
    proposal: Proposal | None = None
    vetoes: int = 0
    _first: int = field(init=False)
    _now_s: float = 0.0
    _changed_s: float | None = None
    """When delta was last changed, or a change vetoed."""
    _judged: int = 0
    """Number of ISA answers that the rule has followed."""

    def __post_init__(self) -> None:
        self._first = self.delta

    def close_step(self, now_s: float, rate_hz: float, answers: Sequence[int]) -> int | None:
        """Take in the rate and the answers to ISA up to a step's end; return the delta to command now, or None."""
        self._now_s = now_s
        if self.proposal is None and self._may_propose:
            wanted = self._wanted(rate_hz, answers)
            if wanted is not None:
                self.proposal = Proposal(wanted, now_s + self.settings.veto_s)
        if self.proposal is None or now_s < self.proposal.due_s:
            return None
        self.delta = self.proposal.delta
        self._end()
        return self.delta

    def veto(self, delta: int | None = None) -> int:
        """Drop the proposal; return its delta. Raises ValueError if there is none, or none with this delta."""
        if self.proposal is None or delta not in (None, self.proposal.delta):
            raise ValueError("there is no change of delta to veto; it may have been made already")
        delta = self.proposal.delta
        self.vetoes += 1
        self._end()
        return delta

    @property
    def _may_propose(self) -> bool:
        return self._changed_s is None or self._now_s - self._changed_s >= self.settings.every_s

    def _end(self) -> None:
        self.proposal, self._changed_s = None, self._now_s

    def _wanted(self, rate_hz: float, answers: Sequence[int]) -> int | None:
        settings = self.settings
        if settings.signal == ISA_ANSWER:
            if len(answers) <= self._judged:
                return None  # one answer is a reason for one change
            self._judged = len(answers)
            is_high, is_low = answers[-1] > settings.isa_high, answers[-1] < settings.isa_low
        else:
            is_high, is_low = rate_hz > self.threshold_hz, rate_hz < settings.relief * self.threshold_hz
        change = {"step": settings.delta_step, "limit": settings.delta_limit}
        return next_delta(self.delta, self._first, is_high=is_high, is_low=is_low, **change)


def first_delta(briefing: Briefing) -> int | None:
    """Return the swarm's initial delta; None if its controller takes none."""
    first = first_of(briefing, SET_DELTA, DELTA)
    return None if first is None else round(first)


def first_of(briefing: Briefing, command: str, name: str) -> float | None:
    """Return what an argument of a command begins with; None if the controller has no such command."""
    form = named(briefing.forms, command)
    return next((argument.default for argument in form.arguments if argument.name == name), None) if form else None


def autonomy_of(briefing: Briefing) -> Autonomy | None:
    operator, delta = briefing.operator, first_delta(briefing)
    if operator.autonomy.sets_delta != SYSTEM or delta is None:
        return None
    return Autonomy(operator.autonomy, operator.threshold_hz, delta)
