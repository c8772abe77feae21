"""The relay: members of a tree carry to the base what its sender cannot reach it with.

A model in the world, no protocol of the agents: which tree an agent is in the world reads off its last act, and who
is near whom off their places. A report goes one hop a step, over links that are open on the air
then (reach, blackouts, walls, jammers, asymmetry; no chance), towards the member with the fewest hops to one
within the base's range. Where there is no way it waits. Each hop loses by the uplink's own share.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from deltaswarm_wire.settings import Scenario
from deltaswarm_world.air.channel.links import Ends
from deltaswarm_world.air.channel.queues import Arrival
from deltaswarm_world.density import Floats
from deltaswarm_world.environment import generator

RELAY_STREAM = 45

TIME_TO_LIVE_S = 60.0
"""A report that its tree has carried for so long is dropped: it tells of what is past."""

SteadyLinks = Callable[[float, Ends], list[tuple[int, int]]]
"""Given a time [s] and agents, sender and receiver of each link among them that is open for a whole step."""


class Moment(NamedTuple):
    """The world as the uplink finds it at the end of a step; all by agent."""

    step: int
    time_s: float
    positions_m: Floats
    there: Sequence[bool]
    """Whether an agent can send and carry: its process is there and its radio works."""
    roots: Mapping[int, int]
    """The root of each agent that is in a tree."""
    within: Sequence[bool]
    """Whether an agent is within the base's range."""


class Trip(NamedTuple):
    """A report on its way through a tree."""

    root: int
    last_step: int


class Way(NamedTuple):
    """How an agent's reports go on: to whom, and over how many hops to one within the base's range."""

    to: int
    hops: int


class Relay:
    """What is carried in one run. Called once a step: `check`, then `hand_on` with those that are still there."""

    def __init__(self, scenario: Scenario, steady_links: SteadyLinks) -> None:
        self.handed: list[Arrival] = []
        """Carriers and what was handed to them in this step; they send it in the next."""
        self.waiting: list[Arrival] = []
        """Carriers and what found no way in this step."""
        self._life = max(1, round(TIME_TO_LIVE_S / scenario.run.step_s))
        self._loss = scenario.uplink.loss
        self._rng = generator(scenario.seed, RELAY_STREAM)
        self._steady_links = steady_links
        self._trips: dict[int, Trip] = {}
        """By the report's number, of those that did not reach the base from their sender."""

    @property
    def under_way(self) -> int:
        """Reports that are carried."""
        return len(self.handed) + len(self.waiting)

    def check(self, moment: Moment, arrival: Arrival) -> str | None:
        """Why a carrier gives up what it carries; None if it does not, or if the report is its own."""
        carrier, packet = arrival
        trip = self._trips.get(packet.number)
        if trip is None:
            return None
        if not moment.there[carrier]:
            return "dead"
        if moment.roots.get(carrier) != trip.root:
            return "left"
        return "expired" if moment.step > trip.last_step else None

    def forget(self, number: int) -> None:
        """The trip of a report is over."""
        self._trips.pop(number, None)

    def hand_on(self, moment: Moment, arrivals: Iterable[Arrival]) -> list[tuple[Arrival, str]]:
        """One hop for all that is beyond the base's range; what is dropped, with the reason."""
        self.handed, self.waiting = [], []
        dropped = []
        ways: dict[int, Way] | None = None
        for carrier, packet in arrivals:
            root = moment.roots.get(carrier)
            if root is None or not moment.there[carrier]:
                dropped.append(((carrier, packet), "range" if root is None else "dead"))
                continue
            self._trips.setdefault(packet.number, Trip(root, moment.step + self._life))
            if ways is None:
                ways = self.ways(moment)
            way = ways.get(carrier)
            if way is None:
                self.waiting.append((carrier, packet))
            elif self._loss > 0 and self._rng.random() < self._loss:
                dropped.append(((carrier, packet), "loss"))
            else:
                self.handed.append((way.to, packet))
        return dropped

    def ways(self, moment: Moment) -> dict[int, Way]:
        """From whom to whom, in this step, for all who are beyond the base's range and have a way to it."""
        members = [agent for agent in sorted(moment.roots) if moment.there[agent]]
        heard_from: dict[int, list[int]] = {}
        ids = np.array(members, dtype=np.int64)
        links = self._steady_links(moment.time_s, Ends(ids, moment.positions_m[ids])) if members else []
        for sender, receiver in links:
            if moment.roots[sender] == moment.roots[receiver]:
                heard_from.setdefault(receiver, []).append(sender)
        nearest = [agent for agent in members if moment.within[agent]]
        found = dict.fromkeys(nearest, Way(-1, 0))
        hops = 0
        while nearest:
            hops += 1
            further = []
            for receiver in nearest:
                for sender in heard_from.get(receiver, ()):
                    if sender not in found:
                        found[sender] = Way(receiver, hops)
                        further.append(sender)
            nearest = sorted(further)
        return {agent: way for agent, way in found.items() if way.hops}
