"""What a kind of fault is: the hooks through which it acts on processes and bodies."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from deltaswarm_wire.messages import Event
from deltaswarm_wire.orders import NOTE, ProcessOrder
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.settings_fault import FaultSettings
from deltaswarm_world.density import Floats


@dataclass
class Spell:
    """A fault that has begun; `index` is its place in the scenario, `end` the first step that it spares."""

    index: int
    fault: FaultSettings
    agents: set[int]
    end: int | None
    rng: np.random.Generator


class Orders:
    """The orders of one step, numbered over the run."""

    def __init__(self, step_s: float) -> None:
        self.given: list[ProcessOrder] = []
        self._step_s = step_s
        self._step = 0
        self._numbered = 0

    def begin(self, step: int) -> None:
        """Start a new list."""
        self.given = []
        self._step = step

    def give(self, action: str, agents: Collection[int], why: str) -> None:
        """Order something for some agents' processes; for no agents only a note is kept."""
        if agents or action == NOTE:
            time_s = self._step * self._step_s
            self.given.append(ProcessOrder(self._numbered, self._step, time_s, action, tuple(sorted(agents)), why))
            self._numbered += 1


class Kind:
    """One kind of fault in one run. What a kind does not override leaves processes and bodies as they are.

    Args:
        scenario: of the run.
        orders: what is to be done to processes.
    """

    name: ClassVar[str]
    """As in `[[fault]]`, from `deltaswarm_wire.settings_fault`."""
    hits_dead: ClassVar[bool] = True
    """Whether it hits agents that are named but dead: the body fails whether or not a process drives it."""

    kills: ClassVar[bool] = False
    """Whether it ends its victims' processes."""

    def __init__(self, scenario: Scenario, orders: Orders) -> None:
        self.agents: frozenset[int] = frozenset()
        """Who suffers from it in this step."""
        self._scenario = scenario
        self._orders = orders

    # When something begins or ends

    def begin(self, spell: Spell, living: set[int], why: str) -> bool:
        """Begin a fault, keeping `living` up to date; whether it lasts."""
        self._orders.give(NOTE, spell.agents, why)
        return True

    def end(self, spell: Spell, living: set[int]) -> None:
        """End a fault, keeping `living` up to date."""
        self._orders.give(NOTE, spell.agents, f"{self.name} ends")

    def see_killed(self, victims: Collection[int], spells: Sequence[Spell]) -> None:
        """Take note of agents killed by a fault of any kind, while these spells of this kind are under way."""

    def look(self, spells: Sequence[Spell]) -> None:
        """Take note of the spells of this kind that are under way from this step on, by their beginning."""
        self.agents = frozenset(agent for spell in spells for agent in spell.agents)

    # In each step, while a spell is under way

    @property
    def blind(self) -> frozenset[int]:
        """Who senses nothing."""
        return frozenset()

    @property
    def deaf(self) -> frozenset[int]:
        """Whose radio neither sends nor receives."""
        return frozenset()

    def misses(self, agent: int) -> bool:
        """Whether an agent misses one event within its sensing range; asked once per agent, event and step."""
        return False

    def distort(self, sensed: Sequence[list[Event]], positions_m: Floats) -> None:
        """Change what agents sense; `sensed` is per agent, positions (n, 2) [m; world frame]."""

    def drive(self, velocities_mps: Floats) -> None:
        """Change the velocities (n, 2) [m/s; world frame] that bodies do in this step."""
