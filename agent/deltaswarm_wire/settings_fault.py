"""Faults: what fails in a run, when, and for whom. A scenario's `[[fault]]` tables are its timeline."""

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
    """What a kind of fault takes besides a time and a target."""

    details: tuple[str, ...] = ()
    """Keys of `FaultSettings` that mean something to this kind; at least one of them is needed."""
    lasts: str = MAY_LAST
    to_process: bool = False
    """Whether it befalls the agent's process, by a real signal where there is one, or its body."""


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
_TARGETS = "one of agents, fraction, roots = true"


@dataclass(frozen=True)
class FaultSettings:
    """One fault: a kind, a time, a target."""

    kind: str = key("", "what fails", choices=FAULTS)
    at_s: float | None = key(None, "start time, rounded up to a step [s]", low=0, high=1e9)
    duration_s: float | None = key(
        None,
        "how long it lasts; restart: how long the agent is away; without it: to the end of the run, restart: at once "
        "[s]",
        above=0,
        high=1e9,
    )
    agents: tuple[int, ...] = key((), "target: these agents", low=0)
    fraction: float | None = key(None, "target: this share of the agents alive then, at random", low=0, high=1)
    roots: bool = key(False, "target: whoever is a root then, by the frames it sends")
    noise_m: float | None = key(
        None, "sensor-noisy: each event is sensed with an error that stays, normal along x and y [m]", above=0, high=1e5
    )
    miss: float | None = key(None, "sensor-noisy: probability of missing an event in a step", above=0, high=1)
    factor: float | None = key(None, "actuator-slow: share of the commanded speed that is left", low=0, high=1)
    phantoms: int | None = key(None, "lying: events that it believes to sense and that do not exist", low=1, high=64)

    def problems(self) -> list[Problem]:
        """What a kind needs must be there, what means nothing to it must not, and the target must be one."""
        if not self.kind:
            return [Problem("kind", "missing", f"one of {', '.join(FAULTS)} is expected")]
        found = [] if self.at_s is not None else [Problem("at_s", "missing", "a time in seconds is expected")]
        targets = [bool(self.agents), self.fraction is not None, self.roots].count(True)
        if targets != 1:
            found.append(Problem("agents", "no target" if not targets else "more than one target", f"{_TARGETS}"))
        if len(set(self.agents)) != len(self.agents):
            found.append(Problem("agents", str(list(self.agents))[:60], "each agent once is allowed"))
        return found + self._problems_of_details()

    def _problems_of_details(self) -> list[Problem]:
        kind = KINDS[self.kind]
        taken = kind.details
        found = [
            Problem(name, f"means nothing to {self.kind}", f"{self.kind} takes {', '.join(taken) or 'no detail'}")
            for name in _DETAILS
            if name not in taken and getattr(self, name) is not None
        ]
        if taken and all(getattr(self, name) is None for name in taken):
            found.append(Problem(taken[0], "missing", f"{self.kind} needs {' or '.join(taken)}"))
        if kind.lasts == MUST_END and self.duration_s is None:
            found.append(Problem("duration_s", "missing", f"{self.kind} needs it"))
        if kind.lasts == NEVER_ENDS and self.duration_s is not None:
            found.append(Problem("duration_s", f"means nothing to {self.kind}", "restart takes it"))
        return found

    def begins(self, step_s: float) -> int:
        """The step before which it begins: the first at or after its time."""
        return math.ceil((self.at_s or 0.0) / step_s - 1e-9)

    def ends(self, step_s: float) -> int | None:
        """The first step that it spares, at least one later; None if it has no end."""
        if self.duration_s is None:
            return None
        return max(self.begins(step_s) + 1, math.ceil(((self.at_s or 0.0) + self.duration_s) / step_s - 1e-9))


def fault_problems(faults: Sequence[FaultSettings], agents: int, steps: int, step_s: float) -> list[Problem]:
    """What the timeline alone cannot show: agents that are not there, times beyond the run."""
    found = []
    for index, fault in enumerate(faults):
        path = f"fault[{index}]"
        strangers = [agent for agent in fault.agents if agent >= agents]
        if strangers:
            shown = ", ".join(map(str, strangers[:8])) + (", ..." if len(strangers) > 8 else "")
            found.append(Problem(f"{path}.agents", f"there is no agent {shown}", f"0 to {agents - 1} is allowed"))
        if not (fault.at_s or 0.0) / step_s < steps or fault.begins(step_s) >= steps:
            found.append(Problem(f"{path}.at_s", f"{fault.at_s:g}", f"a time before {steps * step_s:g} s is allowed"))
    return found
