"""What an agent has come upon of late, for its policy (`policy.py`): what it sensed, heard, reported, and where it was.

Averages fade, and are brought up to date only when there is something to add, as in `finds.py`, so that an agent that
is not asked in every step has the same ones.
"""

import math

from deltaswarm_agent.controllers.paper.finds import Finds
from deltaswarm_agent.controllers.paper.frames import Attending, Member, PaperFrame

FADING_S = 300.0
"""What is this old counts a factor e less."""

FIRST_S = 60.0
"""It begins as if it had sensed one event at a time for so long."""

FIND_RATE_HZ, CROWD, ATTENDING, MEMBERS, REPORTS_HZ, FIND_S, CHANGE_S, PRICE_S = (
    *(1 / 300, 2.0, 0.5, 2.0, 0.1),
    *(100.0, 30.0, 1.0),
)
"""The values at which inputs are 0."""


def scaled(value: float, middle: float) -> float:
    """Return a value of 0 or more on a scale from -1 to 1, on which `middle` is 0."""
    return (value - middle) / (value + middle)


class Experience:
    """The experience of one agent."""

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s
        self._since = 0
        self._events_s, self._sensing_s = FIRST_S, FIRST_S
        """Sensed events times seconds, and the seconds in which it sensed any."""
        self._attending = self._members = self._reports_hz = 0.0
        """How many agents it hears attending and in trees, and how often it reports, on average over time."""
        self._entered = 0
        self._is_in_tree = False
        self._in_trees = 0.0
        """The share of its time in trees, until it last entered or left one, in the step `_entered`."""
        self.found = 0
        """The step in which it last came upon an event."""
        self.changed = 0
        """The step in which its state last changed."""

    def note(self, sensed: int, heard: list[PaperFrame], now: int) -> None:
        """Take the number of events that it senses, and what it hears."""
        if not sensed and not heard:
            return
        self._update(now)
        if sensed:
            self._events_s += sensed * self._step_s
            self._sensing_s += self._step_s
        share = self._step_s / FADING_S
        self._attending += share * sum([type(frame) is Attending for frame in heard])
        self._members += share * sum([type(frame) is Member for frame in heard])

    def report(self, now: int) -> None:
        self._update(now)
        self._reports_hz += 1 / FADING_S

    def begin(self, is_in_tree: bool, now: int) -> None:
        """Say whether it is in a tree from this step on."""
        if is_in_tree != self._is_in_tree:
            self._in_trees = self._share_in_trees(now)
            self._entered, self._is_in_tree = now, is_in_tree

    def inputs(self, finds: Finds, attends: bool, price_s: float, now: int) -> tuple[float, ...]:
        """Return the inputs of `policy.INPUTS`."""
        kept = self._kept(now - self._since)
        return (
            2.0 * finds.busy - 1.0,
            scaled(finds.rate_hz, FIND_RATE_HZ),
            scaled(self._events_s / self._sensing_s, CROWD),
            scaled(kept * self._attending, ATTENDING),
            scaled(kept * self._members, MEMBERS),
            scaled(kept * self._reports_hz, REPORTS_HZ),
            2.0 * self._share_in_trees(now) - 1.0,
            scaled((now - self.found) * self._step_s, FIND_S),
            scaled((now - self.changed) * self._step_s, CHANGE_S),
            1.0 if attends else -1.0,
            scaled(price_s, PRICE_S),
        )

    def _kept(self, steps: int) -> float:
        return math.exp(-steps * self._step_s / FADING_S)

    def _update(self, now: int) -> None:
        kept, self._since = self._kept(now - self._since), now
        self._events_s *= kept
        self._sensing_s *= kept
        self._attending *= kept
        self._members *= kept
        self._reports_hz *= kept

    def _share_in_trees(self, now: int) -> float:
        kept = self._kept(now - self._entered)
        return kept * self._in_trees + (1.0 - kept) * self._is_in_tree
