"""The outcome of frames in one step: who heard what, the drops by reason, and what became of the frames of one link."""

from collections.abc import Sequence

import numpy as np

from deltaswarm_wire.messages import Heard
from deltaswarm_world.core.air.channel.links import Links
from deltaswarm_world.core.air.channel.queues import Arrival
from deltaswarm_world.core.arrays import Mask

EVERYBODY = -1
"""The receiver of frames that are lost before they are on the air."""


class Reception:
    """The outcome of frames in one step."""

    def __init__(self, ends: int) -> None:
        self.heard: list[list[Heard]] = [[] for _ in range(ends)]
        """Received frames per receiver, with their senders, by sender, then age."""
        self.links: list[tuple[int, int]] = []
        """(sender, receiver) of each frame, by receiver, then as in `heard`."""
        self.dropped: dict[str, int] = {}
        self.duplicated = 0
        self.largest_bytes = 0
        """Upper bound of the length of received frames."""
        self.on_air: list[int] = []
        """The sender of each frame on the air in this step."""
        self._in_reach: Links | None = None
        self._cuts: list[tuple[str, Mask]] = []
        self._lost: list[tuple[str, str, Sequence[Arrival]]] = []
        """The reason of a loss, where it happened, and what was lost."""

    def __getstate__(self) -> dict[str, object]:
        """Leave out what only `outcomes` needs, which would make a checkpoint large."""
        return vars(self) | {"on_air": [], "_in_reach": None, "_cuts": [], "_lost": []}

    def hear_all(self, arriving: Sequence[Arrival]) -> None:
        """Add received frames, in order of receiver, then sender and age."""
        heard = self.heard
        for receiver, (sender, _, data) in arriving:
            heard[receiver].append((sender, data))
        self.links = [(sender, receiver) for receiver, (sender, _, _) in arriving]
        self.largest_bytes = max([len(data) for _, (_, _, data) in arriving], default=0)

    def hear_open(self, links: Links, senders: Sequence[int], frames: Sequence[bytes]) -> None:
        """Receive on all open links at once; equal to `hear_all` for frames without delay."""
        is_open = links.is_open
        receivers = links.receivers[is_open].tolist()
        self.links = list(zip(links.senders[is_open].tolist(), receivers, strict=True))
        self.largest_bytes = max(map(len, frames))
        heard, transmissions = self.heard, list(zip(senders, frames, strict=True))
        for column, receiver in zip(links.columns[is_open].tolist(), receivers, strict=True):
            heard[receiver].append(transmissions[column])

    def drop(self, reason: str, count: int) -> None:
        if count:
            self.dropped[reason] = self.dropped.get(reason, 0) + count

    def lose(self, reason: str, where: str, arrivals: Sequence[Arrival], receptions: int = 1) -> None:
        """Count frames that do not go on, each worth this number of receptions."""
        if arrivals:
            self.drop(reason, len(arrivals) * receptions)
            self._lost.append((reason, where, arrivals))

    def cut(self, reason: str, links: Links, cut: Mask) -> None:
        """Cut links, and count those that were open."""
        cut &= links.is_open
        links.is_open ^= cut
        if count := int(np.count_nonzero(cut)):
            self.drop(reason, count)
            self._cuts.append((reason, cut))

    def cross(self, links: Links) -> None:
        """Note the links in reach, before any model cuts one."""
        self._in_reach = links

    def outcomes(self, sender: int, receiver: int, is_listening: bool) -> list[str]:
        """Return what became in this step of the frames from one agent to another, in the order of their way."""
        found = []
        for reason, where, arrivals in self._lost:
            lost = [end for end, packet in arrivals if packet.sender == sender and end in (EVERYBODY, receiver)]
            found += [f"dropped: {reason}, {where}"] * len(lost)
        is_in_reach = (sender, receiver) in self.links
        if (links := self._in_reach) is not None:
            between: Mask = (links.senders == sender) & (links.receivers == receiver)
            is_in_reach = bool(between.any())
            for reason, cut in self._cuts:
                found += [f"dropped: {reason}"] * int(np.count_nonzero(cut & between))
        if not is_in_reach:
            found += [f"dropped: {'range' if is_listening else 'dead'}"] * self.on_air.count(sender)
        return found + ["delivered"] * self.links.count((sender, receiver))

    def losses(self, is_listening: Sequence[bool]) -> list[tuple[int, int, str]]:
        ends, in_reach = range(len(is_listening)), self.links
        lost: list[tuple[int, int, str]] = []
        for reason, _, arrivals in self._lost:
            for receiver, (sender, _, _) in arrivals:
                receivers = [end for end in ends if end != sender] if receiver == EVERYBODY else [receiver]
                lost += [(sender, end, reason) for end in receivers]
        if (links := self._in_reach) is not None:
            in_reach = list(zip(links.senders.tolist(), links.receivers.tolist(), strict=True))
            for reason, cut in self._cuts:
                rows = cut.nonzero()[0].tolist()
                lost += [(*in_reach[row], reason) for row in rows]
        near = set(in_reach)
        for sender in self.on_air:
            far = [end for end in ends if end != sender and (sender, end) not in near]
            lost += [(sender, end, "range" if is_listening[end] else "dead") for end in far]
        return lost
