"""The timeline of faults: starts, ends and targets. Each kind defines its effect.

Pure. The world calls it before each step. Faults of processes become orders; faults of bodies are queried. Each fault
has its own generators, so adding a fault does not change others.
"""

from collections.abc import Collection, Sequence
from typing import Any

from deltaswarm_scenario.fault import FREEZE, NEVER_ENDS, FaultSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.messages import Event
from deltaswarm_wire.orders import ProcessOrder
from deltaswarm_wire.plugins import FAULTS, find
from deltaswarm_world.core.arrays import Floats, generator
from deltaswarm_world.core.faults.kind import ActiveFault, ForeignKind, Kind, Orders

FAULT_STREAM = 11
"""The faults' stream of the run; each fault has two generators: for its targets and for its effect."""


class Faults:
    """The faults of one run."""

    def __init__(self, scenario: Scenario) -> None:
        self.log: list[dict[str, Any]] = []
        """Each started fault: index, kind, step, times [s] and targets."""
        self.deaf: frozenset[int] = frozenset()
        """Agents with a dead radio in this step."""
        self.mute: frozenset[int] = frozenset()
        """Agents with a dead radio in the previous step, whose frames were lost."""
        self._seed = scenario.seed
        self._step_s = scenario.run.step_s
        self._count = scenario.agents.count
        self._faults = scenario.fault
        self._orders = Orders(self._step_s)
        names = dict.fromkeys((*FAULTS.shipped, *(fault.kind for fault in scenario.fault)))
        self._kinds: dict[str, Kind] = {
            name: ForeignKind.make(
                find(FAULTS, name, "fault.kind"), name, scenario, self._orders, context=scenario.agents.count
            )
            for name in names
        }
        self._due = sorted(((fault.begins(self._step_s), index) for index, fault in enumerate(scenario.fault)))[::-1]
        """Step and index of pending faults, the next one last."""
        self.active: list[ActiveFault] = []
        self._active_kinds: list[Kind] = []
        """Kinds with active faults, in the order of the table."""
        self._blind: frozenset[int] = frozenset()

    @property
    def frozen(self) -> frozenset[int]:
        return self._kinds[FREEZE].agents

    @property
    def may_start_agents(self) -> bool:
        """Whether a fault that is to begin or to end may start an agent."""
        faults = [self._faults[index] for _, index in self._due] + [active.fault for active in self.active]
        return any(fault.to_process and self._kinds[fault.kind].lasts != NEVER_ENDS for fault in faults)

    def inject(self, step: int, alive: Collection[int], roots: Collection[int]) -> list[ProcessOrder]:
        """End and begin faults before this step; return the resulting orders, to be executed in order."""
        self.mute = self.deaf
        over = [fault for fault in self.active if fault.end is not None and fault.end <= step]
        if not over and not (self._due and self._due[-1][0] <= step):
            return []
        living = set(alive)
        self._orders.begin(step)
        for fault in over:
            self.active.remove(fault)
            self._kinds[fault.fault.kind].end(fault, living)
        while self._due and self._due[-1][0] <= step:
            self._begin(step, self._due.pop()[1], living, roots)
        for name, kind in self._kinds.items():
            kind.look(self._of(name))
        self._active_kinds = [kind for name, kind in self._kinds.items() if self._of(name)]
        self._blind = frozenset(agent for kind in self._active_kinds for agent in kind.blind)
        self.deaf = frozenset(agent for kind in self._active_kinds for agent in kind.deaf)
        return self._orders.given

    def _begin(self, step: int, index: int, living: set[int], roots: Collection[int]) -> None:
        fault = self._faults[index]
        kind = self._kinds[fault.kind]
        targets = self._targets(index, living, roots)
        end = fault.ends(self._step_s)
        until_s = None if end is None else end * self._step_s
        head = {"fault": index, "kind": fault.kind, "step": step, "at_s": step * self._step_s}
        self.log.append({**head, "until_s": until_s, "agents": sorted(targets)})
        rng = generator(self._seed, FAULT_STREAM, index, 1)
        active = ActiveFault(index=index, fault=fault, settings=fault.own(), agents=targets, end=end, rng=rng)
        if kind.begin(active, living, f"{fault.kind} of {_whom(fault)}"):
            self.active.append(active)
        if kind.kills:
            for name, other in self._kinds.items():
                other.see_killed(targets, self._of(name))

    def _targets(self, index: int, living: set[int], roots: Collection[int]) -> set[int]:
        fault = self._faults[index]
        if fault.agents:
            named = set(fault.agents)
            return named if self._kinds[fault.kind].hits_dead else named & living
        if fault.roots:
            return set(roots) & living
        # Draw over all agents, so that the targets do not depend on earlier deaths.
        shuffled = generator(self._seed, FAULT_STREAM, index, 0).permutation(self._count).tolist()
        wanted = int((fault.fraction or 0.0) * len(living) + 0.5)
        return set([agent for agent in shuffled if agent in living][:wanted])

    @property
    def affected(self) -> frozenset[int]:
        return frozenset(agent for fault in self.active for agent in fault.agents)

    def _of(self, name: str) -> list[ActiveFault]:
        return [fault for fault in self.active if fault.fault.kind == name]

    def redraw(self, seed: int) -> None:
        """Redraw with another seed the targets and effects of the faults that have not begun."""
        self._seed = seed

    # What bodies do and sense in each step

    def seeing(self, present: list[bool]) -> list[bool]:
        """Return whether each agent is present and senses anything."""
        if not self._blind:
            return present
        return [there and agent not in self._blind for agent, there in enumerate(present)]

    def misses(self, agent: int) -> bool:
        return any(kind.misses(agent) for kind in self._active_kinds)

    def distort(self, sensed: Sequence[list[Event]], positions_m: Floats) -> None:
        there_m = positions_m.view()
        there_m.flags.writeable = False  # a sensor moves no body
        for kind in self._active_kinds:
            kind.distort(sensed, there_m)

    def drive(self, velocities_mps: Floats) -> None:
        for kind in self._active_kinds:
            kind.drive(velocities_mps)


def _whom(fault: FaultSettings) -> str:
    if fault.roots:
        return "the roots"
    return "named agents" if fault.agents else f"a share of {fault.fraction:g}"
