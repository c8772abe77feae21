"""Adjustable autonomy: who sets the swarm's delta during a run."""

from dataclasses import dataclass

from deltaswarm_wire.checked import OURS, Problem, key

OPERATOR, SWARM, SYSTEM = "operator", "swarm", "system"
RATE, ISA_ANSWER = "rate", "isa"


@dataclass(frozen=True)
class AutonomySettings:
    """Who sets delta. The system proposes a change, and the person at the station may veto it."""

    sets_delta: str = key(
        OPERATOR,
        "operator: the person, by orders; swarm: each agent for itself; system: a rule at the operator's console",
        choices=(OPERATOR, SWARM, SYSTEM),
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
        return self.sets_delta == SYSTEM

    def problems(self) -> list[Problem]:
        """The rule must be able to act, and its two bounds be in order."""
        problems = []
        if not self.delta_step:
            problems.append(Problem("delta_step", "0", "must not be 0"))
        if self.isa_low > self.isa_high:
            problems.append(Problem("isa_low", f"{self.isa_low:g}", f"must be at most isa_high, {self.isa_high:g}"))
        return problems
