"""Who may begin and who waits: as many sessions at once as the machine carries, in the order in which people came.

Pure: the caller has the clock and says who is there.
"""

from collections.abc import Collection
from dataclasses import dataclass, field


@dataclass
class Line:
    """Places, and people who wait for one; people are told apart by the tokens of their links."""

    at_once: int
    is_open: bool = True
    """Whether new sessions may begin."""
    inside: set[str] = field(default_factory=set)
    waiting: list[str] = field(default_factory=list)

    def ask(self, token: str) -> None:
        """Stand in line, at its end, if not there already."""
        if token not in self.inside and token not in self.waiting:
            self.waiting.append(token)

    def leave(self, token: str) -> None:
        """Give up a place, inside or in line."""
        self.inside.discard(token)
        if token in self.waiting:
            self.waiting.remove(token)

    def admit(self, there: Collection[str], begun: Collection[str] = ()) -> list[str]:
        """Let in as many as there is room for, in order, of those who are there; return them.

        While the line is closed, only those whose session has `begun` before.
        """
        admitted: list[str] = []
        for token in list(self.waiting):
            may = token in there and (self.is_open or token in begun)
            if may and len(self.inside) < self.at_once:
                self.waiting.remove(token)
                self.inside.add(token)
                admitted.append(token)
        return admitted

    def place(self, token: str, there: Collection[str]) -> int:
        """Return the place in line, from 1, among those who are there; 0: not in line."""
        ahead = [other for other in self.waiting if other in there or other == token]
        return ahead.index(token) + 1 if token in ahead else 0


@dataclass
class Limiter:
    """At most so many occurrences per address in a span of time."""

    most: int
    span_s: float
    _seen: dict[str, list[float]] = field(default_factory=dict)

    def allows(self, address: str, now_s: float) -> bool:
        """Count an occurrence; return whether it is within the limit. Addresses that are quiet are forgotten."""
        if len(self._seen) > 1000:
            self._seen = {who: when for who, when in self._seen.items() if now_s - when[-1] < self.span_s}
        recent = [when for when in self._seen.get(address, []) if now_s - when < self.span_s]
        if is_allowed := len(recent) < self.most:
            recent.append(now_s)
        self._seen[address] = recent
        return is_allowed
