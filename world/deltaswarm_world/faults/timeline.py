"""Faults on a timeline: who is hit when, what becomes of processes, and what is wrong with whose body.

Pure. The world asks before each step; what befalls a process goes out as orders, what befalls a body is
kept here and asked for. Each fault has generators of its own, so that adding one changes no other.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltaswarm_wire.codec import MAX_ID
from deltaswarm_wire.messages import Event
from deltaswarm_wire.orders import GO_ON, KILL, NOTE, START, STOP, Order
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.settings_fault import (
    BLIND,
    FREEZE,
    LYING,
    NOISY,
    RADIO_DEAD,
    RESTART,
    SLOW,
    TO_PROCESSES,
    FaultSettings,
)
from deltaswarm_wire.settings_fault import KILL as KILLED
from deltaswarm_world.density import Floats

FAULT_STREAM = 11
"""Of the run's streams of chance; below it each fault has two: for its victims, and for what it does."""

FIRST_PHANTOM = MAX_ID
"""Phantoms are numbered downwards from here, events upwards from 1: they never meet."""


@dataclass
class _Spell:
    """A fault that is under way; `index` is its place in the scenario."""

    index: int
    fault: FaultSettings
    agents: set[int]
    end: int | None
    rng: np.random.Generator


class Faults:
    """The faults of one run."""

    def __init__(self, scenario: Scenario) -> None:
        self.log: list[dict[str, Any]] = []
        """Each fault that has begun: its index, kind, step, times [s] and whom it hit."""
        self.frozen: frozenset[int] = frozenset()
        self.deaf: frozenset[int] = frozenset()
        """Whose radio is dead in this step."""
        self.mute: frozenset[int] = frozenset()
        """Whose radio was dead in the step before: what they said then went nowhere."""
        self.speed_factors: Floats | None = None
        """Per agent what is left of its speed, shape (n, 1); None if all are well."""

        self._seed = scenario.seed
        self._step_s = scenario.run.step_s
        self._count = scenario.agents.count
        self._size_m = (scenario.arena.width_m, scenario.arena.height_m)
        self._sensing_range_m = scenario.agents.sensing_range_m
        self._faults = scenario.fault
        due = sorted((fault.begins(self._step_s), index) for index, fault in enumerate(scenario.fault))
        self._due = due[::-1]
        """Step and index of those to come, the next one last."""
        self._spells: list[_Spell] = []
        self._orders: list[Order] = []
        self._numbered = 0
        self._step = -1
        self._unseeing: frozenset[int] = frozenset()
        self._missing: dict[int, list[_Spell]] = {}
        self._noisy: dict[int, list[_Spell]] = {}
        self._liars: dict[int, _Spell] = {}
        self._errors_m: dict[tuple[int, int, int], tuple[float, float]] = {}
        self._phantoms: dict[int, list[Event]] = {}
        self._next_phantom = FIRST_PHANTOM

    def strike(self, step: int, alive: Collection[int], roots: Collection[int]) -> list[Order]:
        """What ends and what begins before this step; the orders that follow, to be carried out one by one."""
        self.mute = self.deaf
        self._step = step
        over = [spell for spell in self._spells if spell.end is not None and spell.end <= step]
        if not over and not (self._due and self._due[-1][0] <= step):
            return []
        living = set(alive)
        self._orders = []
        for spell in over:
            self._spells.remove(spell)
            if spell.fault.kind == RESTART:
                self._order(START, spell.agents - living, "restart after a while")
                living |= spell.agents
            elif spell.fault.kind != FREEZE:
                self._order(NOTE, spell.agents, f"{spell.fault.kind} ends")
        while self._due and self._due[-1][0] <= step:
            self._begin(self._due.pop()[1], living, roots)
        frozen = frozenset(agent for spell in self._of(FREEZE) for agent in spell.agents)
        self._order(GO_ON, self.frozen - frozen, "freeze ends")
        self._order(STOP, frozen - self.frozen, FREEZE)
        self.frozen = frozen
        self._look_at_bodies()
        return self._orders

    def _order(self, action: str, agents: Collection[int], why: str) -> None:
        if agents or action == NOTE:
            time_s = self._step * self._step_s
            self._orders.append(Order(self._numbered, self._step, time_s, action, tuple(sorted(agents)), why))
            self._numbered += 1

    def _begin(self, index: int, living: set[int], roots: Collection[int]) -> None:
        fault = self._faults[index]
        victims = self._victims(index, living, roots)
        end = fault.ends(self._step_s)
        until_s = None if end is None else end * self._step_s
        head = {"fault": index, "kind": fault.kind, "step": self._step, "at_s": self._step * self._step_s}
        self.log.append({**head, "until_s": until_s, "agents": sorted(victims)})
        why = f"{fault.kind} of {_whom(fault)}"
        if fault.kind in (KILLED, RESTART):
            self._order(KILL, victims & living, why)
            living -= victims
            self.frozen -= victims
            for spell in self._of(FREEZE):
                spell.agents -= victims
        if fault.kind == RESTART and end is None:
            self._order(START, victims, why)
            living |= victims
        elif fault.kind != KILLED:
            rng = np.random.default_rng([self._seed, FAULT_STREAM, index, 1])
            self._spells.append(_Spell(index, fault, victims, end, rng))
        if not victims or fault.kind not in TO_PROCESSES:
            self._order(NOTE, victims, why)

    def _victims(self, index: int, living: set[int], roots: Collection[int]) -> set[int]:
        """Whom a fault hits. By name, the dead count too where a body fails or a process begins anew."""
        fault = self._faults[index]
        if fault.agents:
            named = set(fault.agents)
            return named & living if fault.kind in (KILLED, FREEZE) else named
        if fault.roots:
            return set(roots) & living
        # Of all agents, so that chance hits the same ones however many others have died before.
        shuffled = np.random.default_rng([self._seed, FAULT_STREAM, index, 0]).permutation(self._count).tolist()
        wanted = int((fault.fraction or 0.0) * len(living) + 0.5)
        return set([agent for agent in shuffled if agent in living][:wanted])

    def _of(self, *kinds: str) -> list[_Spell]:
        return [spell for spell in self._spells if spell.fault.kind in kinds]

    def _agents_of(self, *kinds: str) -> frozenset[int]:
        return frozenset(agent for spell in self._of(*kinds) for agent in spell.agents)

    def _look_at_bodies(self) -> None:
        """What is wrong with whom from this step on."""
        self.deaf = self._agents_of(RADIO_DEAD)
        self._unseeing = self._agents_of(BLIND, FREEZE)
        slow = self._of(SLOW)
        self.speed_factors = np.ones((self._count, 1)) if slow else None
        for spell in slow:
            assert self.speed_factors is not None
            self.speed_factors[sorted(spell.agents)] *= spell.fault.factor or 0.0
        self._missing, self._noisy = {}, {}
        for spell in self._of(NOISY):
            for agent in sorted(spell.agents):
                if spell.fault.miss is not None:
                    self._missing.setdefault(agent, []).append(spell)
                if spell.fault.noise_m is not None:
                    self._noisy.setdefault(agent, []).append(spell)
        self._liars = {agent: spell for spell in self._of(LYING) for agent in sorted(spell.agents)}
        self._phantoms = {agent: self._phantoms.get(agent, []) for agent in sorted(self._liars)}

    # Senses

    def seeing(self, present: list[bool]) -> list[bool]:
        """Per agent whether it is there and senses anything."""
        if not self._unseeing:
            return present
        return [there and agent not in self._unseeing for agent, there in enumerate(present)]

    def misses(self, agent: int) -> bool:
        """Whether an agent misses one of the events before it."""
        spells = self._missing.get(agent)
        return spells is not None and any(spell.rng.random() < (spell.fault.miss or 0.0) for spell in spells)

    def distort(self, sensed: Sequence[list[Event]], positions_m: Floats) -> None:
        """Move what noisy sensors sense, and add what liars believe to sense; `sensed` is per agent."""
        for agent, spells in self._noisy.items():
            for spell in spells:
                sensed[agent][:] = [self._displaced(event, agent, spell) for event in sensed[agent]]
        for agent, spell in self._liars.items():
            x_m, y_m = positions_m[agent].tolist()
            phantoms = [event for event in self._phantoms[agent] if self._is_near(event, x_m, y_m)]
            while len(phantoms) < (spell.fault.phantoms or 0):
                phantoms.append(self._phantom(x_m, y_m, spell.rng))
            self._phantoms[agent] = phantoms
            sensed[agent].extend(phantoms)

    def _displaced(self, event: Event, agent: int, spell: _Spell) -> Event:
        """An error that stays: one drawn anew each step would keep agents from ever arriving anywhere."""
        key = (spell.index, agent, event.event)
        if key not in self._errors_m:
            dx_m, dy_m = (spell.rng.standard_normal(2) * (spell.fault.noise_m or 0.0)).tolist()
            self._errors_m[key] = dx_m, dy_m
        dx_m, dy_m = self._errors_m[key]
        return Event(event.event, *self._in_arena(event.x_m + dx_m, event.y_m + dy_m))

    def _phantom(self, x_m: float, y_m: float, rng: np.random.Generator) -> Event:
        radius_m = self._sensing_range_m * float(rng.random()) ** 0.5
        angle = 2 * math.pi * float(rng.random())
        place = self._in_arena(x_m + radius_m * math.cos(angle), y_m + radius_m * math.sin(angle))
        phantom = Event(self._next_phantom, *place)
        self._next_phantom -= 1
        return phantom

    def _is_near(self, event: Event, x_m: float, y_m: float) -> bool:
        return (event.x_m - x_m) ** 2 + (event.y_m - y_m) ** 2 <= self._sensing_range_m**2

    def _in_arena(self, x_m: float, y_m: float) -> tuple[float, float]:
        width_m, height_m = self._size_m
        return min(max(x_m, 0.0), width_m), min(max(y_m, 0.0), height_m)


def _whom(fault: FaultSettings) -> str:
    if fault.roots:
        return "the roots"
    return "named agents" if fault.agents else f"a share of {fault.fraction:g}"
