"""Sequence numbers of agents' messages, which reveal losses on the fabric."""

from collections import Counter
from collections.abc import Mapping

from deltaswarm_wire.saved import Saved


def by_agent(counts: Mapping[int, int]) -> dict[str, int]:
    """Return the nonzero counts, for JSON."""
    return {str(agent): count for agent, count in sorted(counts.items()) if count}


class SequenceNumbers(Saved):
    """Checks the numbers of one kind of message, which count up from 0: a gap is a loss."""

    def __init__(self) -> None:
        self.lost: Counter[int] = Counter()
        """Missing messages by agent."""
        self.fell_back: Counter[int] = Counter()
        """Resets of an agent's number without an absence; many mean that two processes share its id."""
        self._due: dict[int, int | None] = {}

    def follow(self, agent: int, number: int) -> None:
        """Take the number of a message."""
        due = self._due.get(agent, 0)
        if due is not None and number != due:
            if number > due:
                self.lost[agent] += number - due
            else:
                self.fell_back[agent] += 1
        self._due[agent] = number + 1

    def expect_first(self, agent: int) -> None:
        """Expect the next message from a new process."""
        self._due[agent] = 0

    def accept_any_next(self, agent: int) -> None:
        """Accept any number in the next message."""
        self._due[agent] = None
