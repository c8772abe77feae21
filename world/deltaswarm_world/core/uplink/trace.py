"""Follow one agent's reports through the uplink, for `deltaswarm why`."""

from collections.abc import Mapping, Sequence

from deltaswarm_world.core.air.channel.links import Diagnosis, Links
from deltaswarm_world.core.air.channel.queues import Packet
from deltaswarm_world.core.air.channel.reach import RangeDisc
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.uplink.uplink import BASE_INDEX, Uplink


class TracedUplink(Uplink):
    """An uplink that traces one agent's reports; it takes over a running one.

    Args:
        uplink: the running uplink, which must not be used any more.
        sender: the traced agent.
    """

    def __init__(self, uplink: Uplink, sender: int) -> None:
        vars(self).update(vars(uplink))
        self.sender = sender
        self.outcomes: list[str] = []
        """Return the outcomes of the agent's reports in the last step."""
        self._arrived = 0

    def carry(
        self,
        step: int,
        time_s: float,
        positions_m: Floats,
        there: Sequence[bool],
        roots: Mapping[int, int],
        sent: Mapping[int, bytes],
    ) -> list[bytes]:
        """See `Uplink`."""
        self.outcomes = []
        arrived = super().carry(step, time_s, positions_m, there, roots, sent)
        self.outcomes += ["arrived"] * self._arrived
        if self._sending is not None:
            for end in self._sending.ends:
                self._note_own(f"waits in the queue of agent {end}", self._sending.holds(end))
        if self._relay is not None:
            for to, packet in self._relay.handed:
                self._note_own(f"handed on to agent {to}", [packet])
            for end, packet in self._relay.waiting:
                self._note_own(f"waits at agent {end} for a way", [packet])
        if self._delays is not None:
            self.outcomes += [f"under way, due in step {due}" for due in self._delays.due_of(self.sender, BASE_INDEX)]
        if self._taking_in is not None:
            self._note_own("waits in the operator's queue", self._taking_in.holds(BASE_INDEX))
        return arrived

    def _note_own(self, outcome: str, packets: Sequence[Packet]) -> None:
        self.outcomes += [outcome for packet in packets if packet.sender == self.sender]

    def _drop(self, packet: Packet, reason: str, where: str = "") -> None:
        super()._drop(packet, reason, where)
        self._note_own(f"dropped: {reason}{where}", [packet])

    def _take_in(self, packets: list[Packet]) -> list[Packet]:
        passed = super()._take_in(packets)
        self._arrived = sum(packet.sender == self.sender for packet in passed)
        return passed

    def explain(self) -> list[Diagnosis]:
        """Return each model's finding about the agent's link to the operator in the last step, in order."""
        state, sender = self._state, self.sender
        there = state.there[sender]
        says = f"agent {sender} is there" if there else f"agent {sender} is gone, hangs, or its radio is dead"
        diagnoses = [Diagnosis("dead", not there, says, {"gone": [] if there else [sender]})]
        if self._sending is not None:
            diagnoses.append(self._sending.explain(sender, "sender"))
        links = self._links(state, [sender])
        if self._range_m is not None:
            diagnoses.append(self._explain_range(self._range_m, links))
        diagnoses += [model.explain(links, state.time_s) for model in self._models]
        if self._delays is not None:
            diagnoses.append(self._delays.explain())
        if self._taking_in is not None:
            diagnoses.append(self._taking_in.explain(BASE_INDEX, "operator"))
        return diagnoses

    def _explain_range(self, range_m: float, links: Links) -> Diagnosis:
        """Explain with distance and range, and with the relays of an agent out of range."""
        state, sender = self._state, self.sender
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
