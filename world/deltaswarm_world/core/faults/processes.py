"""Faults of an agent's process: kill, freeze, restart. They act through orders."""

from collections.abc import Collection, Sequence

from deltaswarm_scenario.fault import MUST_END, NEVER_ENDS
from deltaswarm_wire.orders import GO_ON, KILL, NOTE, START, STOP
from deltaswarm_world.core.faults.kind import ActiveFault, Kind


class Kill(Kind):
    """The process ends for good; the body stops where it is."""

    lasts = NEVER_ENDS
    to_process = True
    hits_dead = False
    kills = True

    def begin(self, fault: ActiveFault, living: set[int], why: str) -> bool:
        """See `Kind`."""
        targets = fault.agents & living
        self._orders.add(KILL if targets else NOTE, targets, why)
        living -= targets
        return False


class Restart(Kind):
    """The process ends, and a new one begins: at once, or after the duration."""

    to_process = True
    kills = True

    def begin(self, fault: ActiveFault, living: set[int], why: str) -> bool:
        """See `Kind`. Also starts agents without a process."""
        self._orders.add(KILL, fault.agents & living, why)
        living -= fault.agents
        if fault.end is None:
            self._orders.add(START, fault.agents, why)
            living |= fault.agents
        if not fault.agents:
            self._orders.add(NOTE, (), why)
        return fault.end is not None

    def end(self, fault: ActiveFault, living: set[int]) -> None:
        """See `Kind`."""
        self._orders.add(START, fault.agents - living, "restart after a while")
        living |= fault.agents


class Freeze(Kind):
    """The process stops and continues; overlapping freezes merge."""

    lasts = MUST_END
    to_process = True
    hits_dead = False

    def begin(self, fault: ActiveFault, living: set[int], why: str) -> bool:
        """See `Kind`; `look` gives the order."""
        if not fault.agents:
            self._orders.add(NOTE, (), why)
        return True

    def end(self, fault: ActiveFault, living: set[int]) -> None:
        """See `Kind`; `look` gives the order."""

    def see_killed(self, targets: Collection[int], faults: Sequence[ActiveFault]) -> None:
        """See `Kind`. A killed process is not frozen any more."""
        self.agents = self.agents.difference(targets)
        for fault in faults:
            fault.agents.difference_update(targets)

    def look(self, faults: Sequence[ActiveFault]) -> None:
        """See `Kind`."""
        before = self.agents
        super().look(faults)
        self._orders.add(GO_ON, before - self.agents, "freeze ends")
        self._orders.add(STOP, self.agents - before, self.name)

    @property
    def blind(self) -> frozenset[int]:
        """See `Kind`."""
        return self.agents
