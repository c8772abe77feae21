"""Faults: what fails in a run, when, and for which agents. `[[fault]]` tables are the timeline."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from deltaswarm_wire.checked import Problem, key

KILL, FREEZE, RESTART = "kill", "freeze", "restart"
BLIND, NOISY, SLOW, RADIO_DEAD, LYING = "sensor-blind", "sensor-noisy", "actuator-slow", "radio-dead", "lying"
STUCK = "actuator-stuck"
MAY_LAST, MUST_END, NEVER_ENDS = "duration_s is optional", "duration_s is needed", "duration_s means nothing"


@dataclass(frozen=True)
class FaultKind:
    """The keys of a kind of fault besides time and target."""

    details: tuple[str, ...] = ()
    """Keys of `FaultSettings` for this kind; at least one must be given."""
    lasts: str = MAY_LAST
    to_process: bool = False
    """Whether it affects the agent's process (by a real signal, if there is a process) or its body."""


KINDS = {
    KILL: FaultKind(lasts=NEVER_ENDS, to_process=True),
    FREEZE: FaultKind(lasts=MUST_END, to_process=True),
    RESTART: FaultKind(to_process=True),
    BLIND: FaultKind(),
    NOISY: FaultKind(("noise_m", "miss")),
    SLOW: FaultKind(("factor",)),
    STUCK: FaultKind(),
    RADIO_DEAD: FaultKind(),
    LYING: FaultKind(("phantoms",)),
}
"""A new kind is one line here, and one in the world's `faults/kinds.py`."""

FAULTS = tuple(KINDS)
TO_PROCESSES = tuple(name for name, kind in KINDS.items() if kind.to_process)
_DETAILS = tuple(detail for kind in KINDS.values() for detail in kind.details)


@dataclass(frozen=True)
class FaultSettings:
    """One fault: a kind, a time, a target."""

    kind: str = key("", "what fails", choices=FAULTS)
    at_s: float | None = key(None, "start time, rounded up to a step [s]", low=0, high=1e9)
    duration_s: float | None = key(
        None,
        "duration; restart: time before the new start; default: to the end of the run, restart: 0 [s]",
        above=0,
        high=1e9,
    )
    agents: tuple[int, ...] = key((), "target: these agents", low=0)
    fraction: float | None = key(None, "target: random share of the agents alive at the time", low=0, high=1)
    roots: bool = key(False, "target: the agents that are roots at the time, according to their acts")
    noise_m: float | None = key(
        None,
        "sensor-noisy: standard deviation of each event's constant position error along x and y [m]",
        above=0,
        high=1e5,
    )
    miss: float | None = key(None, "sensor-noisy: probability of missing an event in a step", above=0, high=1)
    factor: float | None = key(None, "actuator-slow: remaining share of the commanded speed", low=0, high=1)
    phantoms: int | None = key(None, "lying: number of nonexistent events that the agent senses", low=1, high=64)

    def problems(self) -> list[Problem]:
        """There must be exactly one target and the keys of the kind, no others."""
        if not self.kind:
            return [Problem("kind", "nothing", f"must be one of {', '.join(FAULTS)}")]
        problems = [] if self.at_s is not None else [Problem("at_s", "nothing", "must be a time in seconds")]
        targets = [bool(self.agents), self.fraction is not None, self.roots].count(True)
        if targets != 1:
            problems.append(
                Problem("agents", f"{targets} targets", "must be the one target, or else fraction or roots = true")
            )
        if len(set(self.agents)) != len(self.agents):
            problems.append(Problem("agents", str(list(self.agents))[:60], "must name each agent once"))
        return problems + self._problems_of_details()

    def _problems_of_details(self) -> list[Problem]:
        kind = KINDS[self.kind]
        taken = kind.details
        problems = [
            Problem(
                name, f"{getattr(self, name)}", f"must be left out: {self.kind} takes {', '.join(taken) or 'no detail'}"
            )
            for name in _DETAILS
            if name not in taken and getattr(self, name) is not None
        ]
        if taken and all(getattr(self, name) is None for name in taken):
            problems.append(Problem(taken[0], "nothing", f"must be given: {self.kind} needs {' or '.join(taken)}"))
        if kind.lasts == MUST_END and self.duration_s is None:
            problems.append(Problem("duration_s", "nothing", f"must be given for {self.kind}"))
        if kind.lasts == NEVER_ENDS and self.duration_s is not None:
            problems.append(
                Problem("duration_s", f"{self.duration_s:.15g}", f"must be left out for {self.kind}; restart takes it")
            )
        return problems

    def begins(self, step_s: float) -> int:
        """The step before which the fault begins: the first at or after `at_s`."""
        return math.ceil((self.at_s or 0.0) / step_s - 1e-9)

    def ends(self, step_s: float) -> int | None:
        """The first step after the fault, at least one later; None if the fault has no end."""
        if self.duration_s is None:
            return None
        return max(self.begins(step_s) + 1, math.ceil(((self.at_s or 0.0) + self.duration_s) / step_s - 1e-9))


def fault_problems(faults: Sequence[FaultSettings], agents: int, steps: int, step_s: float) -> list[Problem]:
    """Check the timeline against the scenario: unknown agents, times beyond the run."""
    problems = []
    for index, fault in enumerate(faults):
        path = f"fault[{index}]"
        strangers = [agent for agent in fault.agents if agent >= agents]
        if strangers:
            shown = ", ".join(map(str, strangers[:8])) + (", ..." if len(strangers) > 8 else "")
            problems.append(Problem(f"{path}.agents", shown, f"must be from 0 to {agents - 1}"))
        if not (fault.at_s or 0.0) / step_s < steps or fault.begins(step_s) >= steps:
            problems.append(Problem(f"{path}.at_s", f"{fault.at_s:.15g}", f"must be before {steps * step_s:.15g} s"))
    return problems
