"""The relay: members of a tree forward reports from senders out of the base's range.

It is a model in the world, not a protocol of agents: it takes trees from the agents' last acts and links from their
positions. A report moves one hop per step over links open at the time (reach, blackouts, walls, obstacles, jammers,
asymmetry; no random loss), towards the member with the fewest hops to a member within the base's range. Without a path
it waits. Each hop has the uplink's loss.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.air.channel.links import Ends
from deltaswarm_world.core.air.channel.queues import Arrival
from deltaswarm_world.core.arrays import Floats, generator

RELAY_STREAM = 45

TIME_TO_LIVE_S = 60.0
"""Maximum time of a relayed report; older reports are dropped as outdated."""

SteadyLinks = Callable[[float, Ends], list[tuple[int, int]]]
"""Maps a time [s] and agents to sender and receiver of each link among them that is open for a whole step."""


class StepState(NamedTuple):
    step: int
    time_s: float
    positions_m: Floats
    there: Sequence[bool]
    """Whether an agent can send and relay: its process is present and its radio works."""
    roots: Mapping[int, int]
    """The root of each agent in a tree."""
    within: Sequence[bool]
    """Whether an agent is within the base's range."""


class RelayedReport(NamedTuple):
    root: int
    last_step: int


class Route(NamedTuple):
    """Next hop of an agent's reports, and the hops to a member within the base's range."""

    to: int
    hops: int


class Relay:
    """The relayed reports of one run. Once per step, call `check`, then `hand_on` with the remaining reports."""

    def __init__(self, scenario: Scenario, steady_links: SteadyLinks) -> None:
        self.handed: list[Arrival] = []
        """Relays with reports received in this step, which they send in the next."""
        self.waiting: list[Arrival] = []
        """Relays with reports without a path in this step."""
        self._life = max(1, round(TIME_TO_LIVE_S / scenario.run.step_s))
        self._loss = scenario.uplink.loss
        self._rng = generator(scenario.seed, RELAY_STREAM)
        self._steady_links = steady_links
        self._relayed: dict[int, RelayedReport] = {}
        """By number, reports that did not reach the base directly."""

    @property
    def under_way(self) -> int:
        return len(self.handed) + len(self.waiting)

    def check(self, state: StepState, arrival: Arrival) -> str | None:
        """Return why a relay drops a report; None if it keeps it or the report is its own."""
        carrier, packet = arrival
        trip = self._relayed.get(packet.number)
        if trip is None:
            return None
        if not state.there[carrier]:
            return "dead"
        if state.roots.get(carrier) != trip.root:
            return "left"
        return "expired" if state.step > trip.last_step else None

    def forget(self, number: int) -> None:
        self._relayed.pop(number, None)

    def hand_on(self, state: StepState, arrivals: Iterable[Arrival]) -> list[tuple[Arrival, str]]:
        """Move all reports beyond the base's range by one hop; return the dropped ones with reasons."""
        self.handed, self.waiting = [], []
        dropped = []
        ways: dict[int, Route] | None = None
        for carrier, packet in arrivals:
            root = state.roots.get(carrier)
            if root is None or not state.there[carrier]:
                dropped.append(((carrier, packet), "range" if root is None else "dead"))
                continue
            self._relayed.setdefault(packet.number, RelayedReport(root, state.step + self._life))
            if ways is None:
                ways = self.ways(state)
            way = ways.get(carrier)
            if way is None:
                self.waiting.append((carrier, packet))
            elif self._loss > 0 and self._rng.random() < self._loss:
                dropped.append(((carrier, packet), "loss"))
            else:
                self.handed.append((way.to, packet))
        return dropped

    def ways(self, state: StepState) -> dict[int, Route]:
        """Return the next hops in this step for all agents beyond the base's range with a path to it."""
        members = [agent for agent in sorted(state.roots) if state.there[agent]]
        heard_from: dict[int, list[int]] = {}
        ids = np.array(members, dtype=np.int64)
        links = self._steady_links(state.time_s, Ends(ids, state.positions_m[ids])) if members else []
        for sender, receiver in links:
            if state.roots[sender] == state.roots[receiver]:
                heard_from.setdefault(receiver, []).append(sender)
        nearest = [agent for agent in members if state.within[agent]]
        routes = dict.fromkeys(nearest, Route(-1, 0))
        hops = 0
        while nearest:
            hops += 1
            further = []
            for receiver in nearest:
                for sender in heard_from.get(receiver, ()):
                    if sender not in routes:
                        routes[sender] = Route(receiver, hops)
                        further.append(sender)
            nearest = sorted(further)
        return {agent: way for agent, way in routes.items() if way.hops}
