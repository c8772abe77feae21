"""The time-out of agents that are late again and again."""

from collections import Counter
from collections.abc import Collection

FORGIVEN_STEPS = 2500
"""After this many steps the backoff with a late agent doubles again, up to its initial value."""

MAX_MISSES = 20
"""Maximum number of counted misses; almost no backoff is left then."""


class TimeoutBackoff:
    """Time that a step waits for an agent: half as long after each missed step.

    So an agent that is always late costs a run of n steps at most (2 + n / FORGIVEN_STEPS) times `most_s` [s].
    """

    def __init__(self, most_s: float) -> None:
        self.most_s = most_s
        self._misses: Counter[int] = Counter()
        self._forgiven_at: dict[int, int] = {}
        """The step at which the next miss of an agent is forgiven."""

    def left_s(self, agent: int, step: int) -> float:
        """Return the time that this step may wait for an agent [s]."""
        return self.most_s * 0.5 ** self._counted(agent, step)

    def with_any(self, agents: Collection[int], step: int) -> tuple[float, float]:
        """Return the shortest and the longest time that this step may wait for one of these agents [s]."""
        if not self._misses or not agents:
            return self.most_s, self.most_s
        left_s = [self.left_s(agent, step) for agent in agents]
        return min(left_s), max(left_s)

    def missed(self, agent: int, step: int) -> None:
        """Note that an agent missed this step."""
        if not self._counted(agent, step):
            self._forgiven_at[agent] = step + FORGIVEN_STEPS
        self._misses[agent] = min(self._misses[agent] + 1, MAX_MISSES)

    def _counted(self, agent: int, step: int) -> int:
        while self._misses[agent] and step >= self._forgiven_at[agent]:
            self._misses[agent] -= 1
            self._forgiven_at[agent] += FORGIVEN_STEPS
        return self._misses[agent]
