"""Return to finds (site fidelity; not in the paper): a walker remembers where events were, and goes back there.

Events come where others came before. So with a probability p a new leg of the walk leads near a remembered place;
otherwise it is random. p follows what either kind of leg finds: 0.5 (1 - (r0/r1)^2), at least 0.05, with r0 and r1 the
finds per second on random and on returning legs. A place to which a whole leg led back in vain is forgotten.
"""

from collections import deque

from deltaswarm_agent.controller import ControllerContext
from deltaswarm_agent.controllers.paper.finds import Finds
from deltaswarm_wire.messages import Pose

MAX_PLACES = 32
"""Maximum number of places that an agent remembers."""

SPREAD_M = 5.0
"""A leg ends near the place: a normal distribution with this standard deviation."""

MOST, LEAST = 0.5, 0.05
"""Bounds of the probability of a returning leg."""


def return_probability(ratio: float) -> float:
    """Return p for r0 / r1."""
    return max(LEAST, MOST * (1.0 - ratio**2))


class FoundPlaces:
    """The places at which an agent newly sensed an event, or met an attending agent, each for `memory_steps`."""

    def __init__(self, memory_steps: int, finds: Finds, context: ControllerContext) -> None:
        self._memory_steps = memory_steps
        self._finds = finds
        self._rng = context.rng
        self._size_m = (context.shared.width_m, context.shared.height_m)
        self.places: deque[tuple[float, float, int]] = deque(maxlen=MAX_PLACES)
        """Positions [m] and steps of finds."""
        self._goal: tuple[float, float, int] | None = None
        """Where the present leg leads back to, as long as nothing has been found on it."""

    def add(self, x_m: float, y_m: float, now: int) -> None:
        self.places.append((x_m, y_m, now))
        self._goal = None

    def give_up_goal(self) -> None:
        """End a leg before its time: that says nothing about its place."""
        self._goal = None

    def next_goal(self, now: int) -> Pose | None:
        """End the present leg, and return where in the arena the next one leads [m]; None: it is a random one."""
        if self._goal is not None and self._goal in self.places:
            self.places.remove(self._goal)
        self._goal = None
        places = [place for place in self.places if now - place[2] <= self._memory_steps]
        if not places or self._rng.random() >= return_probability(self._finds.ratio):
            return None
        self._goal = self._rng.choice(places)
        x_m, y_m, _ = self._goal
        x_m, y_m = self._rng.gauss(x_m, SPREAD_M), self._rng.gauss(y_m, SPREAD_M)
        return min(max(x_m, 0.0), self._size_m[0]), min(max(y_m, 0.0), self._size_m[1])
