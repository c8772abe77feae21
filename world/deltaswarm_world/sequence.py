"""Sequence numbers of agents' messages: they show what the fabric lost."""

from collections import Counter
from collections.abc import Mapping


def by_agent(counts: Mapping[int, int]) -> dict[str, int]:
    """Counts that are not 0, as JSON has them."""
    return {str(agent): count for agent, count in sorted(counts.items()) if count}


class SequenceNumbers:
    """The numbers of agents' messages of one kind, from 0 up by 1: a gap is a loss."""

    def __init__(self) -> None:
        self.lost: Counter[int] = Counter()
        """Messages that are missing, by agent."""
        self.fell_back: Counter[int] = Counter()
        """How often an agent's number did not grow, and it had not been away: often, if two processes act as it."""
        self._due: dict[int, int | None] = {}

    def follow(self, agent: int, number: int) -> None:
        """Take the number of a message that came."""
        due = self._due.get(agent, 0)
        if due is not None and number != due:
            if number > due:
                self.lost[agent] += number - due
            else:
                self.fell_back[agent] += 1
        self._due[agent] = number + 1

    def begin_anew(self, agent: int) -> None:
        """Its next message is that of a new process."""
        self._due[agent] = 0

    def go_on_anywhere(self, agent: int) -> None:
        """Its next message may have any number."""
        self._due[agent] = None
