"""Follow the frames of one link for `deltaswarm why`, without a cost for untraced runs."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from deltaswarm_world.core.air.channel.links import Diagnosis, Ends, LinkModel, Links, Mask
from deltaswarm_world.core.air.channel.queues import Arrival, Packet
from deltaswarm_world.core.air.radio import Air, Reception
from deltaswarm_world.core.arrays import Floats


class TracedAir(Air):
    """Radio that traces the frames of one agent at another; it takes over a running `Air`.

    Args:
        air: the running radio, which must not be used any more.
        sender: the traced sender.
        receiver: the traced receiver.
    """

    def __init__(self, air: Air, sender: int, receiver: int) -> None:
        vars(self).update(vars(air))
        self.sender, self.receiver = sender, receiver
        self._outcomes: list[str] = []
        self._models = air._models
        self._models = [_TracedModel(model, self._note_cuts) for model in self._models]
        if self._sending is not None:
            spy(self._sending, "take", self._note_sending)
            spy(self._sending, "clear", self._note_sender_gone)
        if self._delays is not None:
            spy(self._delays, "take", self._note_arrival)
        if self._taking_in is not None:
            spy(self._taking_in, "take", self._note_taking_in)
            spy(self._taking_in, "clear", self._note_receiver_gone)

    def carry(
        self,
        step: int,
        time_s: float,
        transmitted: Mapping[int, bytes],
        positions_m: Floats,
        listening: Sequence[bool],
        mute: Collection[int] = (),
    ) -> Reception:
        """See `Air`."""
        self._outcomes = []
        self._listening = listening
        reception = super().carry(step, time_s, transmitted, positions_m, listening, mute)
        self._note("delivered", reception.links.count((self.sender, self.receiver)))
        if self._sending is not None:
            self._note("waits in the sender's queue", len(self._sending.holds(self.sender)))
        if self._delays is not None:
            due = self._delays.due_of(self.sender, self.receiver)
            self._outcomes += [f"under way, due in step {due_step}" for due_step in due]
        if self._taking_in is not None:
            held = self._own([(self.receiver, packet) for packet in self._taking_in.holds(self.receiver)])
            self._note("waits in the receiver's queue", held)
        self._note("dropped: dead, the sender's radio", self.sender in transmitted and self.sender in mute)
        return reception

    def outcomes_of(self, links: Sequence[tuple[int, int]]) -> list[str]:
        """Return the outcomes of the link's frames in the last step, given the received links."""
        outcomes = list(self._outcomes)
        for _ in range(outcomes.count("delivered") - list(links).count((self.sender, self.receiver))):
            outcomes[outcomes.index("delivered")] = "dropped: frame_full"
        return outcomes

    def explain(self, speaking: Sequence[bool]) -> list[Diagnosis]:
        """Return each model's finding about the link in the last step, in order.

        Args:
            speaking: whether each agent's radio worked when this step's frames were sent.
        """
        time_s, positions_m, listening = self._moment
        sender, receiver = (Ends(np.array([agent]), positions_m[[agent]]) for agent in (self.sender, self.receiver))
        links = Links.of_pairs(sender, receiver)
        gone = [] if speaking[self.sender] else [self.sender]
        gone += [] if listening[self.receiver] else [self.receiver]
        says = f"agent {gone[0]} is gone, hangs, or its radio is dead" if gone else "both are there"
        diagnoses = [Diagnosis("dead", bool(gone), says, {"gone": gone})]
        diagnoses.append(self._reach.explain(links, time_s))
        diagnoses += [model.explain(links, time_s) for model in self._models]
        if self._delays is not None:
            diagnoses.append(self._delays.explain())
        for queue, end, whose in (
            (self._sending, self.sender, "sender"),
            (self._taking_in, self.receiver, "receiver"),
        ):
            if queue is not None:
                diagnoses.append(queue.explain(end, whose))
        return diagnoses

    def _note(self, outcome: str, count: int) -> None:
        self._outcomes += [outcome] * count

    def _own(self, arrivals: Sequence[Arrival]) -> int:
        """Return the number of the link's frames."""
        return sum(packet.sender == self.sender and end == self.receiver for end, packet in arrivals)

    # On the air

    def _hear_at_once(self, senders: list[int], frames: list[bytes], reception: Reception) -> None:
        super()._hear_at_once(senders, frames, reception)
        self._note_reach(senders, (self.sender, self.receiver) in reception.links)

    def _cross(self, senders: list[int], frames: list[bytes], reception: Reception) -> Links:
        links = super()._cross(senders, frames, reception)
        self._note_reach(senders, bool(self._between(links).any()))
        return links

    def _note_reach(self, senders: Sequence[int], is_in_reach: bool) -> None:
        if not is_in_reach:
            reason = "range" if self._listening[self.receiver] else "dead"
            self._note(f"dropped: {reason}", senders.count(self.sender))

    def _between(self, links: Links) -> Mask:
        between: Mask = (links.senders == self.sender) & (links.receivers == self.receiver)
        return between

    def _note_cuts(self, reason: str, cut: Mask, links: Links) -> None:
        self._note(f"dropped: {reason}", int(np.count_nonzero(cut & links.is_open & self._between(links))))

    # In queues and under way

    def _note_sending(self, sent_and_dropped: tuple[list[Packet], list[Packet]], end: int, *_: object) -> None:
        if end == self.sender:
            self._note("dropped: bandwidth, the sender's queue is full", len(sent_and_dropped[1]))

    def _note_sender_gone(self, cleared: list[Packet], end: int) -> None:
        if end == self.sender:
            self._note("dropped: dead, in the sender's queue", len(cleared))

    def _note_arrival(self, due: list[Arrival], *_: object) -> None:
        if not self._listening[self.receiver]:
            self._note("dropped: dead, on arrival", self._own(due))

    def _note_taking_in(self, sent_and_dropped: tuple[list[Packet], list[Packet]], end: int, *_: object) -> None:
        lost = self._own([(end, packet) for packet in sent_and_dropped[1]])
        self._note("dropped: bandwidth, the receiver's queue is full", lost)

    def _note_receiver_gone(self, cleared: list[Packet], end: int) -> None:
        self._note("dropped: dead, in the receiver's queue", self._own([(end, packet) for packet in cleared]))


class _TracedModel:
    """A model that traces its cuts, except for the relay, which uses the same models."""

    def __init__(self, model: LinkModel, see: Callable[[str, Mask, Links], None]) -> None:
        self.reason, self.holds_for_step = model.reason, model.holds_for_step
        self.explain = model.explain
        self._model, self._see = model, see

    def cuts(self, links: Links, time_s: float) -> Mask | None:
        """See `LinkModel`."""
        cut = self._model.cuts(links, time_s)
        if cut is not None:
            self._see(self.reason, cut, links)
        return cut


def spy(part: object, name: str, see: Callable[..., None]) -> None:
    """Pass each result of a part's method, with its arguments, to `see`."""
    method = getattr(part, name)

    def spied(*arguments: Any) -> Any:
        result = method(*arguments)
        see(result, *arguments)
        return result

    setattr(part, name, spied)
