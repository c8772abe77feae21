"""Faults of an agent's drive and radio."""

from collections.abc import Sequence

from deltaswarm_wire import settings_fault
from deltaswarm_wire.settings import Scenario
from deltaswarm_world.density import Floats
from deltaswarm_world.faults.kind import Kind, Orders, Spell


class Slow(Kind):
    """The body does a share of the commanded speed; shares multiply."""

    name = settings_fault.SLOW

    def __init__(self, scenario: Scenario, orders: Orders) -> None:
        super().__init__(scenario, orders)
        self._factors: list[tuple[list[int], float]] = []

    def look(self, spells: Sequence[Spell]) -> None:
        """See `Kind`."""
        super().look(spells)
        self._factors = [(sorted(spell.agents), spell.fault.factor or 0.0) for spell in spells]

    def drive(self, velocities_mps: Floats) -> None:
        """See `Kind`."""
        for agents, factor in self._factors:
            velocities_mps[agents] *= factor


class RadioDead(Kind):
    """The radio neither sends nor receives."""

    name = settings_fault.RADIO_DEAD

    @property
    def deaf(self) -> frozenset[int]:
        """See `Kind`."""
        return self.agents
