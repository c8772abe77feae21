"""What becomes of an agent whose body crashes: it fails, and its process ends. Pure."""

from collections.abc import Mapping

from deltaswarm_wire.codec import MAX_ID
from deltaswarm_wire.orders import KILL, ProcessOrder
from deltaswarm_world.core.participants import Participants

FIRST_CRASH = MAX_ID
"""Orders about crashes are numbered downwards from here, those of faults upwards from 0."""


class Crashes:
    """The crashes of one run that were handled."""

    def __init__(self) -> None:
        self._handled: set[int] = set()

    def fail(
        self, crashes: Mapping[int, str], participants: Participants, step: int, time_s: float
    ) -> list[ProcessOrder]:
        """Let the agents fail whose bodies crashed in the step before; return the orders to end their processes.

        `crashes` tells how the bodies crashed that have done so up to now, by agent.
        """
        orders: list[ProcessOrder] = []
        for agent in sorted(crashes.keys() - self._handled):
            self._handled.add(agent)
            if agent in participants.present:
                participants.token_gone(agent, crashes[agent])
                orders.append(ProcessOrder(FIRST_CRASH - agent, step, time_s, KILL, (agent,), crashes[agent]))
        return orders
