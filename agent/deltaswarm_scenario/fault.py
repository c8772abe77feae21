"""Faults: what fails in a run, when, and for which agents. `[[fault]]` tables are the timeline."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from deltaswarm_wire.checked import Problem, SettingsError, key, rest, unknown_key
from deltaswarm_wire.plugins import FAULTS, find, is_recorded, own_settings

FREEZE = "freeze"
MAY_LAST, MUST_END, NEVER_ENDS = "duration_s is optional", "duration_s is needed", "duration_s means nothing"


@dataclass(frozen=True)
class FaultSettings:
    """One fault: a kind, a time, a target."""

    kind: str = key("", "what fails: a shipped name, an entry point, or module:Class")
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
    options: dict[str, Any] = rest("the kind's own options")

    @property
    def to_process(self) -> bool:
        """Whether the fault affects the agent's process (by a real signal, if there is a process) or its body."""
        return bool(getattr(find(FAULTS, self.kind, "kind"), "to_process", False))

    def own(self) -> Any:
        """Return the kind's own settings, from the options.

        Raises:
            SettingsError: with every mistake in them.
        """
        return own_settings(FAULTS, self.kind, self.options, "", "kind")

    def problems(self) -> list[Problem]:
        """There must be exactly one target and the keys of the kind, no others."""
        if not self.kind:
            return [Problem("kind", "nothing", f"must be one of {', '.join(FAULTS.shipped)}, or module:Class")]
        problems = [] if self.at_s is not None else [Problem("at_s", "nothing", "must be a time in seconds")]
        targets = [bool(self.agents), self.fraction is not None, self.roots].count(True)
        if targets != 1:
            problems.append(
                Problem("agents", f"{targets} targets", "must be the one target, or else fraction or roots = true")
            )
        if len(set(self.agents)) != len(self.agents):
            problems.append(Problem("agents", str(list(self.agents))[:60], "must name each agent once"))
        return problems + self._problems_of_kind()

    def _problems_of_kind(self) -> list[Problem]:
        try:
            kind = find(FAULTS, self.kind, "kind")
        except SettingsError as error:
            return error.problems
        problems: list[Problem] = []
        if is_recorded(kind):
            return problems
        if kind.lasts == MUST_END and self.duration_s is None:
            problems.append(Problem("duration_s", "nothing", f"must be given for {self.kind}"))
        if kind.lasts == NEVER_ENDS and self.duration_s is not None:
            problems.append(
                Problem("duration_s", f"{self.duration_s:.15g}", f"must be left out for {self.kind}; restart takes it")
            )
        known = [spec.name for of in (self, kind.Settings) for spec in dataclasses.fields(of) if spec.name != "options"]
        unknown = [name for name in self.options if name not in known]
        problems += [unknown_key(name, known) for name in unknown]
        try:
            dataclasses.replace(self, options={n: v for n, v in self.options.items() if n not in unknown}).own()
        except SettingsError as error:
            problems += error.problems
        return problems

    def begins(self, step_s: float) -> int:
        """The step before which the fault begins: the first at or after `at_s`."""
        return math.ceil((self.at_s or 0.0) / step_s - 1e-9)

    def ends(self, step_s: float) -> int | None:
        """The first step after the fault, at least one later; None if the fault has no end."""
        if self.duration_s is None:
            return None
        return max(self.begins(step_s) + 1, math.ceil(((self.at_s or 0.0) + self.duration_s) / step_s - 1e-9))


def fault_problems(
    faults: Sequence[FaultSettings], agents: int, steps: int, step_s: float, dynamics: str
) -> list[Problem]:
    """Check the timeline against the scenario: unknown agents, times beyond the run, bodies of other dynamics."""
    problems = []
    for index, fault in enumerate(faults):
        path = f"fault[{index}]"
        needed = getattr(find(FAULTS, fault.kind, f"{path}.kind"), "dynamics", dynamics)
        if needed != dynamics:
            problems.append(Problem(f"{path}.kind", repr(fault.kind), f"must go with world.dynamics = {needed!r}"))
        strangers = [agent for agent in fault.agents if agent >= agents]
        if strangers:
            shown = ", ".join(map(str, strangers[:8])) + (", ..." if len(strangers) > 8 else "")
            problems.append(Problem(f"{path}.agents", shown, f"must be from 0 to {agents - 1}"))
        if not (fault.at_s or 0.0) / step_s < steps or fault.begins(step_s) >= steps:
            problems.append(Problem(f"{path}.at_s", f"{fault.at_s:.15g}", f"must be before {steps * step_s:.15g} s"))
    return problems
