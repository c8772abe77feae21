"""Emulated radio: which frames reach which receivers, when, and why not.

Each frame is tried once at every other agent. These effects apply in order: the sender's queue (`bandwidth`); then in
one step a missing receiver (`dead`), reach (`range`), blackouts, walls (`partition`), obstacles (`obstacle`), jammers
(`jam`), `asymmetry`, `loss`, bursts (`burst`), `contention`; then duplication and delay; on arrival again a missing
receiver (`dead`); and the receiver's queue (`bandwidth`). The first effect that drops a frame is the reason. (Frames
beyond the room in an agent's own frame are `frame_full`; the core drops them.) A duplicate is one more reception:

    sent x other agents + duplicated = received + dropped, by reason + in flight
"""

from collections.abc import Collection, Mapping, Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.air.channel.links import Diagnosis, Ends, Links
from deltaswarm_world.core.air.channel.model import models_of, reasons_of
from deltaswarm_world.core.air.channel.queues import Arrival, DelayLine, Packet, RateLimitedQueue, delays_of, queue_of
from deltaswarm_world.core.air.channel.reach import reach_of
from deltaswarm_world.core.air.reception import EVERYBODY, Reception
from deltaswarm_world.core.arrays import Floats, Mask, generator

SHADOWING_STREAM = 31
JITTER_STREAM, DUPLICATION_STREAM, COPY_STREAM, ORDER_STREAM = 35, 36, 37, 38
ROUNDING_STREAM, COPY_ROUNDING_STREAM = 39, 40
"""Each random effect has its own generator, and so has each model."""


class _Moment(NamedTuple):
    time_s: float
    positions_m: Floats
    listening: Sequence[bool]


class Air:
    """The radio of one run, with all its models; call it once per step, in order."""

    def __init__(self, scenario: Scenario) -> None:
        count, radio, step_s = scenario.agents.count, scenario.radio, scenario.run.step_s
        self._ids = np.arange(count)
        self._reach = reach_of(radio, count, generator(scenario.seed, SHADOWING_STREAM))
        self._models = models_of(scenario, self._reach)
        self.reasons = reasons_of(self._models)
        """Every reason for a drop, in the order of the columns in tables."""
        self._steady = [model for model in self._models if model.holds_for_step]
        width = radio.bandwidth
        self._sending = queue_of(width.sender_bytes_per_s, width.queue_bytes, step_s)
        self._taking_in = queue_of(width.receiver_bytes_per_s, width.queue_bytes, step_s)
        self._duplication = radio.duplication
        self._delays: DelayLine | None = None
        if radio.latency_s > 0 or radio.jitter_s > 0 or radio.duplication > 0:
            self._delays = delays_of(radio, scenario, JITTER_STREAM, ROUNDING_STREAM)
        self._copies_rng = generator(scenario.seed, DUPLICATION_STREAM)
        self._copy_delays = delays_of(radio, scenario, COPY_STREAM, COPY_ROUNDING_STREAM)
        self._order_rng = generator(scenario.seed, ORDER_STREAM)
        """Random order of senders into the queues of a step, so that low numbers have no priority."""
        self._numbers = 0
        self._moment = _Moment(0.0, np.zeros((count, 2)), [True] * count)
        self._reception = Reception(count)

    @property
    def under_way(self) -> int:
        packets = 0
        if self._sending is not None:
            packets += self._sending.waiting * (len(self._ids) - 1)
        if self._delays is not None:
            packets += self._delays.waiting
        if self._taking_in is not None:
            packets += self._taking_in.waiting
        return packets

    def carry(
        self,
        step: int,
        time_s: float,
        transmitted: Mapping[int, bytes],
        positions_m: Floats,
        listening: Sequence[bool],
        mute: Collection[int] = (),
    ) -> Reception:
        """Run one step: frames by sender, positions (n, 2) [m], present receivers, muted senders."""
        self._reception = reception = Reception(len(listening))
        senders = sorted(transmitted)
        if mute:
            senders = [sender for sender in senders if sender not in mute]
            silent = [(EVERYBODY, Packet(sender, -1, b"")) for sender in transmitted.keys() & mute]
            reception.lose("dead", "the sender's radio", silent, len(listening) - 1)
        frames = [transmitted[sender] for sender in senders]
        if self._sending is not None:
            senders, frames = self._send(self._sending, senders, frames, listening, reception)
        self._moment = _Moment(time_s, positions_m, listening)
        reception.on_air = senders
        is_late = self._delays is not None or self._taking_in is not None
        if not (is_late or self._models):
            self._hear_at_once(senders, frames, reception)
            return reception
        links = self._cross(senders, frames, reception) if frames else None
        if is_late:
            arriving = [] if links is None else self._set_off(step, links, senders, frames, reception)
            self._deliver(step, arriving, listening, reception)
        elif links is not None:
            reception.hear_open(links, senders, frames)
        return reception

    def steady_links(self, time_s: float, agents: Ends) -> list[tuple[int, int]]:
        """Return sender and receiver of each link among agents that is open for a whole step, random effects aside."""
        rows, columns, spare_db = self._reach.find(agents, agents)
        others = rows != columns
        links = Links(agents, agents, (), columns[others], rows[others])
        if spare_db is not None:
            links.spare_db = spare_db[others]
        for model in self._steady:
            cut = model.cuts(links, time_s)
            if cut is not None:
                links.is_open &= ~cut
        is_open = links.is_open
        return list(zip(links.senders[is_open].tolist(), links.receivers[is_open].tolist(), strict=True))

    # Questions about the last step, which change nothing

    def explain(self, sender: int, receiver: int, speaking: Sequence[bool]) -> list[Diagnosis]:
        """Return each model's finding about one link in the last step, in order.

        Args:
            sender: the sending agent.
            receiver: the receiving agent.
            speaking: whether each agent's radio worked when this step's frames were sent.
        """
        time_s, positions_m, listening = self._moment
        ends = [Ends(np.array([agent]), positions_m[[agent]]) for agent in (sender, receiver)]
        links = Links.of_pairs(ends[0], ends[1])
        gone = [agent for agent, works in ((sender, speaking[sender]), (receiver, listening[receiver])) if not works]
        says = f"agent {gone[0]} is gone, hangs, or its radio is dead" if gone else "both are there"
        findings = [Diagnosis("dead", bool(gone), says, {"gone": gone}), self._reach.explain(links, time_s)]
        findings += [model.explain(links, time_s) for model in self._models]
        if self._delays is not None:
            findings.append(self._delays.explain())
        for queue, end, whose in ((self._sending, sender, "sender"), (self._taking_in, receiver, "receiver")):
            if queue is not None:
                findings.append(queue.explain(end, whose))
        return findings

    def outcomes(self, sender: int, receiver: int) -> list[str]:
        """Return what became in the last step of the frames from one agent to another, those in flight included."""
        found = self._reception.outcomes(sender, receiver, self._moment.listening[receiver])
        if self._sending is not None:
            found += ["waits in the sender's queue"] * len(self._sending.holds(sender))
        if self._delays is not None:
            found += [f"under way, due in step {due}" for due in self._delays.due_of(sender, receiver)]
        if self._taking_in is not None:
            held = self._taking_in.holds(receiver)
            found += ["waits in the receiver's queue" for packet in held if packet.sender == sender]
        return found

    # On the way of a frame

    def _send(
        self,
        queue: RateLimitedQueue,
        senders: list[int],
        frames: list[bytes],
        listening: Sequence[bool],
        reception: Reception,
    ) -> tuple[list[int], list[bytes]]:
        """Pass frames through the senders' queues; return those on the air now, by sender, then age."""
        new = dict(zip(senders, frames, strict=True))
        narrow = queue.pass_wide({sender: len(data) for sender, data in new.items()})
        if not narrow:
            return senders, frames
        others = len(listening) - 1
        on_air: list[tuple[int, bytes]] = []
        for sender in narrow:
            arriving = self._packets([sender], [new.pop(sender)]) if sender in new else []
            passed, dropped = queue.take(sender, arriving)
            on_air += [(sender, packet.data) for packet in passed]
            gone = [] if listening[sender] else queue.clear(sender)
            full = "the sender's queue is full"
            reception.lose("bandwidth", full, [(EVERYBODY, packet) for packet in dropped], others)
            reception.lose("dead", "in the sender's queue", [(EVERYBODY, packet) for packet in gone], others)
        on_air = sorted([*on_air, *new.items()], key=itemgetter(0))
        return [sender for sender, _ in on_air], [data for _, data in on_air]

    def _packets(self, senders: list[int], frames: list[bytes]) -> list[Packet]:
        first, self._numbers = self._numbers, self._numbers + len(frames)
        return list(map(Packet._make, zip(senders, range(first, self._numbers), frames, strict=True)))

    def _hear_at_once(self, senders: list[int], frames: list[bytes], reception: Reception) -> None:
        """Receive in reach: equal to `_cross` without models, in half the time."""
        if not frames:
            return
        positions_m, listening = self._moment.positions_m, self._moment.listening
        speaking = np.array(senders)
        rows, columns, _ = self._reach.find(Ends(self._ids, positions_m), Ends(speaking, positions_m[speaking]))
        heard: Mask = speaking[columns] != rows
        dead = 0
        if absent := listening.count(False):
            heard &= np.array(listening)[rows]
            dead = sum(absent - (not listening[sender]) for sender in senders)
            reception.drop("dead", dead)
        columns, receivers = columns[heard], rows[heard].tolist()
        reception.links = list(zip(speaking[columns].tolist(), receivers, strict=True))
        reception.largest_bytes = max(map(len, frames))
        reception.drop("range", len(senders) * (len(listening) - 1) - dead - len(receivers))
        transmissions = list(zip(senders, frames, strict=True))
        for column, receiver in zip(columns.tolist(), receivers, strict=True):
            reception.heard[receiver].append(transmissions[column])

    def _cross(self, senders: list[int], frames: list[bytes], reception: Reception) -> Links:
        """Apply the models to all links in reach; return the links with the open ones marked."""
        time_s, positions_m, listening = self._moment
        speaking = np.array(senders)
        listeners, speakers = Ends(self._ids, positions_m), Ends(speaking, positions_m[speaking])
        rows, columns, spare_db = self._reach.find(listeners, speakers)
        is_there: Mask = speaking[columns] != rows
        absent = listening.count(False)
        if absent:
            is_there &= np.array(listening)[rows]
        there = is_there.nonzero()[0]
        links = Links(speakers, listeners, frames, columns[there], rows[there])
        if spare_db is not None:
            links.spare_db = spare_db[there]
        dead = sum(absent - (not listening[sender]) for sender in senders) if absent else 0
        reception.drop("dead", dead)
        reception.drop("range", len(senders) * (len(listening) - 1) - dead - len(links))
        reception.cross(links)
        for model in self._models:
            cut = model.cuts(links, time_s)
            if cut is not None:
                reception.cut(model.reason, links, cut)
        return links

    def _set_off(
        self, step: int, links: Links, senders: list[int], frames: list[bytes], reception: Reception
    ) -> list[Arrival]:
        """Duplicate and delay frames; return those that arrive at once."""
        packets = self._packets(senders, frames)
        is_open = links.is_open.nonzero()[0]
        columns, receivers = links.columns[is_open].tolist(), links.receivers[is_open].tolist()
        crossed = list(zip(receivers, [packets[column] for column in columns], strict=True))
        delays = self._delays
        if delays is None:
            return crossed
        arriving = delays.send(step, crossed, delays.draw(len(links))[is_open].tolist())
        if self._duplication > 0:
            later = self._copy_delays.draw(len(links))[is_open]
            copied = (self._copies_rng.random(len(links)) < self._duplication)[is_open]
            copies = [crossed[row] for row in copied.nonzero()[0].tolist()]
            reception.duplicated = len(copies)
            arriving += delays.send(step, copies, later[copied].tolist())
        return arriving

    def _deliver(self, step: int, arriving: list[Arrival], listening: Sequence[bool], reception: Reception) -> None:
        if self._delays is not None:
            due = self._delays.take(step)
            arriving += [arrival for arrival in due if listening[arrival[0]]]
            reception.lose("dead", "on arrival", [arrival for arrival in due if not listening[arrival[0]]])
        if self._taking_in is not None:
            arriving = self._take_in(self._taking_in, arriving, listening, reception)
        arriving.sort()
        reception.hear_all(arriving)

    def _take_in(
        self, queue: RateLimitedQueue, arriving: list[Arrival], listening: Sequence[bool], reception: Reception
    ) -> list[Arrival]:
        """Pass frames through the receivers' queues; return the passed ones in any order."""
        order = self._order_rng.random(len(listening)).tolist()
        loads: dict[int, int] = {}
        for receiver, (_, _, data) in arriving:
            loads[receiver] = loads.get(receiver, 0) + len(data)
        by_receiver: dict[int, list[Packet]] = {receiver: [] for receiver in queue.pass_wide(loads)}
        passing = []
        for arrival in arriving:
            if arrival[0] in by_receiver:
                by_receiver[arrival[0]].append(arrival[1])
            else:
                passing.append(arrival)
        for receiver, packets in by_receiver.items():
            if not listening[receiver]:
                gone = [(receiver, packet) for packet in queue.clear(receiver)]
                reception.lose("dead", "in the receiver's queue", gone)
                continue
            packets.sort(key=lambda packet: (order[packet.sender], packet.number))
            passed, dropped = queue.take(receiver, packets)
            full = "the receiver's queue is full"
            reception.lose("bandwidth", full, [(receiver, packet) for packet in dropped])
            passing += [(receiver, packet) for packet in passed]
        return passing
