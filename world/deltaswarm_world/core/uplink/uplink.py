"""The operator's uplink: which reports reach the operator, when, and why not.

Each report is tried once. These effects apply in order: a missing sender (`dead`); the sender's queue (`bandwidth`);
the base's range (`range`, or the relay, `relay.py`, with each relay's queue and `loss` at each hop); then outages
(`outage`), `loss` and bursts (`burst`) on the link to the base; then delay; and the queue of the operator's radio
(`base_full`). The first effect that drops a report is the reason:

    sent = arrived + dropped, by reason + in flight
"""

from collections.abc import Mapping, Sequence

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.air.channel.links import Diagnosis, Ends, Links
from deltaswarm_world.core.air.channel.loss import Bursts, Loss
from deltaswarm_world.core.air.channel.model import Model
from deltaswarm_world.core.air.channel.queues import Arrival, DelayLine, Packet, delays_of, queue_of
from deltaswarm_world.core.air.channel.reach import RangeDisc
from deltaswarm_world.core.air.channel.zones import Blackouts
from deltaswarm_world.core.arrays import Floats, generator
from deltaswarm_world.core.uplink.relay import Relay, SteadyLinks, StepState

LOSS_STREAM, BURST_STREAM, JITTER_STREAM, ORDER_STREAM, ROUNDING_STREAM = 41, 42, 43, 44, 46
"""Each model has its own stream, as for radio; the relay's is 45."""

BASE_INDEX = 0
"""The operator's radio as the only end of its queue."""


class Uplink:
    """The uplink of one run, with all its models; call `carry` at the end of every step, in order."""

    def __init__(self, scenario: Scenario, steady_links: SteadyLinks) -> None:
        uplink, count, step_s = scenario.uplink, scenario.agents.count, scenario.run.step_s
        self.dropped: dict[str, int] = {}
        self.losses: list[tuple[int, str]] = []
        """Sender and reason of each dropped report of the last step."""
        self._outcomes: list[tuple[str, Packet]] = []
        """What became of each report that arrived or was dropped in the last step."""
        self._count = count
        self._base_m: Floats = np.array(uplink.base_m or (0.0, 0.0))
        self._range_m = uplink.range_m
        self._relay = Relay(scenario, steady_links) if uplink.relay else None
        self._models: list[Model] = []
        if uplink.outages:
            self._models.append(Blackouts(uplink.outages, "outage"))
        if uplink.loss > 0:
            self._models.append(Loss(uplink.loss, generator(scenario.seed, LOSS_STREAM)))
        if uplink.burst.is_on:
            rng = generator(scenario.seed, BURST_STREAM)
            self._models.append(Bursts(uplink.burst, count, step_s, rng, to_one=True))
        self._delays: DelayLine | None = None
        if uplink.latency_s > 0 or uplink.jitter_s > 0:
            self._delays = delays_of(uplink, scenario, JITTER_STREAM, ROUNDING_STREAM)
        width = uplink.bandwidth
        self._sending = queue_of(width.sender_bytes_per_s, width.queue_bytes, step_s)
        self._taking_in = queue_of(width.receiver_bytes_per_s, width.queue_bytes, step_s)
        self._order_rng = generator(scenario.seed, ORDER_STREAM)
        """Random order into the operator's queue, so that low numbers have no priority."""
        self._numbers = 0
        self._state = StepState(-1, 0.0, np.zeros((count, 2)), [True] * count, {}, [True] * count)

    @property
    def under_way(self) -> int:
        parts = (self._sending, self._delays, self._taking_in)
        return sum(part.waiting for part in parts if part is not None) + (self._relay.under_way if self._relay else 0)

    def carry(
        self,
        step: int,
        time_s: float,
        positions_m: Floats,
        there: Sequence[bool],
        roots: Mapping[int, int],
        sent: Mapping[int, bytes],
    ) -> list[bytes]:
        """Run one step with positions [m], presence and root by agent, and reports; return arrived reports."""
        self.dropped, self.losses, self._outcomes = {}, [], []
        self._state = state = StepState(step, time_s, positions_m, there, roots, self._within(positions_m))
        entering = []
        for sender in sorted(sent):
            self._numbers += 1
            packet = Packet(sender, self._numbers, sent[sender])
            if there[sender]:
                entering.append((sender, packet))
            else:
                self._drop(packet, "dead")
        near = self._near(state, entering)
        arriving = [(BASE_INDEX, packet) for packet in self._cross(state, near)]
        if self._delays is not None:
            arriving = self._delays.send(step, arriving, self._delays.draw(len(arriving)).tolist())
            arriving += self._delays.take(step)
        arrived = sorted(self._take_in([packet for _, packet in arriving]))
        self._outcomes += [("arrived", packet) for packet in arrived]
        return [packet.data for packet in arrived]

    # Questions about the last step, which change nothing

    def explain(self, sender: int) -> list[Diagnosis]:
        """Return each model's finding about an agent's link to the operator in the last step, in order."""
        state = self._state
        there = state.there[sender]
        says = f"agent {sender} is there" if there else f"agent {sender} is gone, hangs, or its radio is dead"
        findings = [Diagnosis("dead", not there, says, {"gone": [] if there else [sender]})]
        if self._sending is not None:
            findings.append(self._sending.explain(sender, "sender"))
        links = self._links(state, [sender])
        if self._range_m is not None:
            findings.append(self._explain_range(self._range_m, sender, links))
        findings += [model.explain(links, state.time_s) for model in self._models]
        if self._delays is not None:
            findings.append(self._delays.explain())
        if self._taking_in is not None:
            findings.append(self._taking_in.explain(BASE_INDEX, "operator"))
        return findings

    def _explain_range(self, range_m: float, sender: int, links: Links) -> Diagnosis:
        """Explain with distance and range, and with the relays of an agent out of range."""
        state = self._state
        direct = RangeDisc(range_m).explain(links, state.time_s)
        says = f"{direct.says} from the operator's base"
        if self._relay is None or not direct.cuts:
            return direct._replace(says=says)
        if sender not in state.roots:
            return direct._replace(says=f"{says}; in no tree that could carry it")
        way = self._relay.ways(state).get(sender)
        if way is None:
            return direct._replace(says=f"{says}; the tree of root {state.roots[sender]} has no way to it now")
        says = f"{says}; its tree carries it, first to agent {way.to}, over {way.hops} hops to one within range"
        return direct._replace(cuts=False, says=says, numbers={**direct.numbers, **way._asdict()})

    def outcomes(self, sender: int) -> list[str]:
        """Return what became of an agent's reports in the last step, those in flight included."""
        found = list(self._outcomes)
        if self._sending is not None:
            for end in self._sending.ends:
                found += [(f"waits in the queue of agent {end}", packet) for packet in self._sending.holds(end)]
        if self._relay is not None:
            found += [(f"handed on to agent {to}", packet) for to, packet in self._relay.handed]
            found += [(f"waits at agent {end} for a way", packet) for end, packet in self._relay.waiting]
        if self._taking_in is not None:
            found += [("waits in the operator's queue", packet) for packet in self._taking_in.holds(BASE_INDEX)]
        due = [] if self._delays is None else self._delays.due_of(sender, BASE_INDEX)
        own = [outcome for outcome, packet in found if packet.sender == sender]
        return own + [f"under way, due in step {step}" for step in due]

    # On the way of a report

    def _within(self, positions_m: Floats) -> Sequence[bool]:
        if self._range_m is None:
            return [True] * self._count
        offsets = positions_m - self._base_m
        within: list[bool] = (offsets[:, 0] ** 2 + offsets[:, 1] ** 2 <= self._range_m**2).tolist()
        return within

    def _drop(self, packet: Packet, reason: str, where: str = "") -> None:
        self.dropped[reason] = self.dropped.get(reason, 0) + 1
        self.losses.append((packet.sender, reason))
        self._outcomes.append((f"dropped: {reason}{where}", packet))
        if self._relay:
            self._relay.forget(packet.number)

    def _near(self, state: StepState, entering: list[Arrival]) -> list[Arrival]:
        """Pass reports through the senders' queues and the relay; return those on the link to the base."""
        relay, within = self._relay, state.within
        if relay is None:
            on_air = self._send(state, entering)
            for end, packet in on_air:
                if not within[end]:
                    self._drop(packet, "range")
            return [(end, packet) for end, packet in on_air if within[end]]
        near, beyond = [], []
        for end, packet in sorted(self._send(state, entering + relay.handed) + relay.waiting, key=_by_carrier):
            if reason := relay.check(state, (end, packet)):
                self._drop(packet, reason, f", at agent {end}")
            elif within[end]:
                relay.forget(packet.number)
                near.append((end, packet))
            else:
                beyond.append((end, packet))
        for (end, packet), reason in relay.hand_on(state, beyond):
            self._drop(packet, reason, f", at agent {end}")
        return near

    def _send(self, state: StepState, entering: list[Arrival]) -> list[Arrival]:
        """Pass reports through the queues of senders and relays; return those on the air, by relay, then age."""
        entering.sort(key=_by_carrier)
        queue = self._sending
        if queue is None:
            return entering
        by_end: dict[int, list[Packet]] = {}
        for end, packet in entering:
            by_end.setdefault(end, []).append(packet)
        on_air = []
        for end in sorted(by_end.keys() | queue.ends):
            passed, dropped = queue.take(end, by_end.get(end, []))
            on_air += [(end, packet) for packet in passed]
            for packet in dropped:
                self._drop(packet, "bandwidth", f", the queue of agent {end} is full")
            for packet in [] if state.there[end] else queue.clear(end):
                self._drop(packet, "dead", f", in the queue of agent {end}")
        return on_air

    def _cross(self, state: StepState, near: list[Arrival]) -> list[Packet]:
        """Apply the models of the link to the base; return the received reports."""
        if not near:
            return []
        links = self._links(state, [end for end, _ in near])
        for model in self._models:
            cut = model.cuts(links, state.time_s)
            if cut is None:
                continue
            cut &= links.is_open
            links.is_open &= ~cut
            for row in np.flatnonzero(cut).tolist():
                self._drop(near[row][1], model.reason)
        return [near[row][1] for row in np.flatnonzero(links.is_open).tolist()]

    def _links(self, state: StepState, senders: Sequence[int]) -> Links:
        """Make links from agents, ascending, to the base, the end after the last agent."""
        ids = np.array(senders)
        base = Ends(np.full(len(ids), self._count), np.tile(self._base_m, (len(ids), 1)))
        return Links.of_pairs(Ends(ids, state.positions_m[ids]), base)

    def _take_in(self, packets: list[Packet]) -> list[Packet]:
        queue = self._taking_in
        if queue is None:
            return packets
        order = self._order_rng.random(self._count).tolist()
        packets.sort(key=lambda packet: (order[packet.sender], packet.number))
        passed, dropped = queue.take(BASE_INDEX, packets)
        for packet in dropped:
            self._drop(packet, "base_full")
        return passed


def _by_carrier(arrival: Arrival) -> tuple[int, int]:
    end, packet = arrival
    return end, packet.number
