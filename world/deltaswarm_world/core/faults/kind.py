"""The interface of a kind of fault: hooks that act on processes and bodies."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from deltaswarm_scenario.fault import MAY_LAST, FaultSettings
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.codec import MAX_ABS_M, MAX_ID
from deltaswarm_wire.foreign import Foreign
from deltaswarm_wire.messages import MAX_SPEED_MPS, Event
from deltaswarm_wire.orders import ACTIONS, NOTE, ProcessOrder
from deltaswarm_wire.plugins import NoSettings
from deltaswarm_world.core.arrays import Floats, checked_agents, checked_rows, checked_truth


@dataclass
class ActiveFault:
    """A started fault; `index` is its index in the scenario, `end` the first step after it."""

    index: int
    fault: FaultSettings
    settings: Any
    agents: set[int]
    end: int | None
    rng: np.random.Generator


class Orders:
    def __init__(self, step_s: float) -> None:
        self.given: list[ProcessOrder] = []
        self._step_s = step_s
        self._step = 0
        self._numbered = 0

    def begin(self, step: int) -> None:
        self.given = []
        self._step = step

    def add(self, action: str, agents: Collection[int], why: str) -> None:
        """Add an order for some agents' processes; without agents, a note."""
        if action not in ACTIONS:
            raise ValueError(f"action must be one of {', '.join(ACTIONS)} (got {action!r:.80})")
        if agents or action == NOTE:
            time_s = self._step * self._step_s
            self.given.append(ProcessOrder(self._numbered, self._step, time_s, action, tuple(sorted(agents)), why))
            self._numbered += 1


class Kind:
    """One kind of fault in one run. Hooks that a kind does not override have no effect.

    Args:
        name: the name in `[[fault]]`.
        scenario: the run's scenario.
        orders: collects the orders for processes.
    """

    Settings: ClassVar[type] = NoSettings
    """A frozen dataclass of the kind's own keys in `[[fault]]`."""
    lasts: ClassVar[str] = MAY_LAST
    """Whether a fault may, must or cannot have a duration: MAY_LAST, MUST_END or NEVER_ENDS."""
    to_process: ClassVar[bool] = False
    """Whether it affects the agent's process (by a real signal, if there is a process) or its body."""
    hits_dead: ClassVar[bool] = True
    """Whether it also affects named agents without a process: a body can fail without one."""

    kills: ClassVar[bool] = False
    """Whether it ends its targets' processes."""

    # A class attribute `dynamics` names the only `world.dynamics` that it goes with; without it, all.

    def __init__(self, name: str, scenario: Scenario, orders: Orders) -> None:
        self.name = name
        self.agents: frozenset[int] = frozenset()
        self._scenario = scenario
        self._orders = orders

    # When something begins or ends

    def begin(self, fault: ActiveFault, living: set[int], why: str) -> bool:
        """Begin a fault and update `living`; return whether the fault lasts."""
        self._orders.add(NOTE, fault.agents, why)
        return True

    def end(self, fault: ActiveFault, living: set[int]) -> None:
        """End a fault and update `living`."""
        self._orders.add(NOTE, fault.agents, f"{self.name} ends")

    def see_killed(self, targets: Collection[int], faults: Sequence[ActiveFault]) -> None:
        """Note agents killed by a fault of any kind during these active faults of this kind."""

    def look(self, faults: Sequence[ActiveFault]) -> None:
        """Note the active faults of this kind from this step on, by start."""
        self.agents = frozenset(agent for fault in faults for agent in fault.agents)

    # In each step, while a fault is under way

    @property
    def blind(self) -> frozenset[int]:
        """Return the agents that sense nothing."""
        return frozenset()

    @property
    def deaf(self) -> frozenset[int]:
        """Return the agents whose radio neither sends nor receives."""
        return frozenset()

    def misses(self, agent: int) -> bool:
        """Whether an agent misses one event within its sensing range; called once per agent, event and step."""
        return False

    def distort(self, sensed: Sequence[list[Event]], positions_m: Floats) -> None:
        """Change what agents sense; `sensed` is per agent, positions (n, 2) [m; world frame]."""

    def drive(self, velocities_mps: Floats) -> None:
        """Change the velocities (n, 2) [m/s; world frame] that bodies do in this step."""


def _begun(agents: int, value: Any, fault: ActiveFault, living: Any, why: str) -> bool:
    checked_agents(living, agents)
    return checked_truth(agents, value)


def _ended(agents: int, value: Any, fault: ActiveFault, living: Any) -> None:
    checked_agents(living, agents)


def _driven(agents: int, value: Any, velocities_mps: Floats) -> None:
    if value is not None:
        raise ValueError(f"must change the velocities in place, and return None (got {type(value).__name__})")
    checked_rows(velocities_mps, agents, "leave velocities [m/s]", -MAX_SPEED_MPS, MAX_SPEED_MPS)


def _distorted(agents: int, value: Any, sensed: Sequence[Any], positions_m: Floats) -> None:
    if value is not None:
        raise ValueError(f"must change what is sensed in place, and return None (got {type(value).__name__})")
    if len(sensed) != agents:
        raise ValueError(f"must leave a list for each of {agents} agents (got {len(sensed)})")
    for agent, events in enumerate(sensed):
        if wrong := [event for event in events if not _is_event(event)]:
            raise ValueError(
                f"must leave Events with an id and a finite position (got {wrong[0]!r:.80} of agent {agent})"
            )


def _is_event(event: Any) -> bool:
    if type(event) is not Event:
        return False
    number, x_m, y_m = event
    is_number = type(number) is int and isinstance(x_m, float | int) and isinstance(y_m, float | int)
    return is_number and 0 <= number <= MAX_ID and abs(x_m) <= MAX_ABS_M and abs(y_m) <= MAX_ABS_M


class ForeignKind(Foreign):
    """A kind of fault from outside; its context is the number of agents."""

    CHECKS: ClassVar = {
        "begin": _begun,
        "end": _ended,
        **dict.fromkeys(("agents", "blind", "deaf"), lambda agents, value: checked_agents(value, agents)),
        "misses": checked_truth,
        "distort": _distorted,
        "drive": _driven,
    }
