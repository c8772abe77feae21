"""Faults of an agent's process: kill, freeze, restart. They act through orders."""

from collections.abc import Collection, Sequence

from deltaswarm_wire import settings_fault
from deltaswarm_wire.orders import GO_ON, KILL, NOTE, START, STOP
from deltaswarm_world.faults.kind import Kind, Spell


class Kill(Kind):
    """The process ends for good; the body stops where it is."""

    name = settings_fault.KILL
    hits_dead = False
    kills = True

    def begin(self, spell: Spell, living: set[int], why: str) -> bool:
        """See `Kind`."""
        victims = spell.agents & living
        self._orders.give(KILL if victims else NOTE, victims, why)
        living -= victims
        return False


class Restart(Kind):
    """The process ends, and a new one begins: at once, or after the duration."""

    name = settings_fault.RESTART
    kills = True

    def begin(self, spell: Spell, living: set[int], why: str) -> bool:
        """See `Kind`. Also starts agents without a process."""
        self._orders.give(KILL, spell.agents & living, why)
        living -= spell.agents
        if spell.end is None:
            self._orders.give(START, spell.agents, why)
            living |= spell.agents
        if not spell.agents:
            self._orders.give(NOTE, (), why)
        return spell.end is not None

    def end(self, spell: Spell, living: set[int]) -> None:
        """See `Kind`."""
        self._orders.give(START, spell.agents - living, "restart after a while")
        living |= spell.agents


class Freeze(Kind):
    """The process stops and continues; overlapping freezes merge."""

    name = settings_fault.FREEZE
    hits_dead = False

    def begin(self, spell: Spell, living: set[int], why: str) -> bool:
        """See `Kind`; `look` gives the order."""
        if not spell.agents:
            self._orders.give(NOTE, (), why)
        return True

    def end(self, spell: Spell, living: set[int]) -> None:
        """See `Kind`; `look` gives the order."""

    def see_killed(self, victims: Collection[int], spells: Sequence[Spell]) -> None:
        """See `Kind`. A killed process is not frozen any more."""
        self.agents = self.agents.difference(victims)
        for spell in spells:
            spell.agents.difference_update(victims)

    def look(self, spells: Sequence[Spell]) -> None:
        """See `Kind`."""
        before = self.agents
        super().look(spells)
        self._orders.give(GO_ON, before - self.agents, "freeze ends")
        self._orders.give(STOP, self.agents - before, self.name)

    @property
    def blind(self) -> frozenset[int]:
        """See `Kind`."""
        return self.agents
