"""Where a run from the beginning turns into a branch of it: from there on generators may be seeded in every step."""

import hashlib
import random
from collections import Counter

import numpy as np

from deltaswarm_dense.setting_up import Redraw
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.workload import WorkloadMeter
from deltaswarm_orchestrator.run.engine import Turn
from deltaswarm_orchestrator.run.randomness import Randomness
from deltaswarm_orchestrator.run.state import Cores
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.world import WorldCore

KEY_BYTES = 4 * 32
"""Room for the longest text that seeds a generator, with its hash."""

NO_KEYS = np.zeros((0, 0, 0), np.uint32)


def redraw_of(turn: Turn | None) -> Redraw:
    """Return from which step on, and by which seed, arrivals are drawn anew."""
    return (turn.at_step, turn.randomness.seed) if turn is not None and turn.randomness is not None else None


def until_turn(turn: Turn | None, first: int, last: int) -> int:
    """Return before which step a block must end that could go on until the last."""
    return min([last, *(step for step in (turn[:2] if turn else ()) if step > first)])


class Redrawn:
    """The generators of a run that are seeded anew before each step, each by its place in the run's state."""

    def __init__(self, scenario: Scenario, randomness: Randomness, world: WorldCore, console: Console) -> None:
        count = scenario.agents.count
        agents = {agent: random.Random() for agent in range(count)}  # in their places; theirs are in arrays
        meter = WorkloadMeter(scenario.operator, scenario.run.step_s)
        randomness.find(Cores(world, agents, Counter(), meter, console))  # type: ignore[arg-type]
        self._randomness, self._count = randomness, count
        self._first = [id(found) for found in randomness.generators].index(id(agents[0]))

    def begin_step(self, step: int) -> None:
        """Seed the world's generators for a step."""
        self._randomness.begin_step(step, slice(self._first))

    def keys(self, first: int, steps: int) -> np.ndarray:
        """Return the keys of the agents' generators for some steps.

        They are (steps, n, 33) uint32: how many numbers a key has, and these.
        """
        places = range(self._first, self._first + self._count)
        keys = [_key(self._randomness.text(place, first + step)) for step in range(steps) for place in places]
        return np.frombuffer(b"".join(keys), "<u4").reshape(steps, self._count, -1).copy()

    def begin_close(self, step: int) -> None:
        """Seed the console's generators for a step."""
        self._randomness.begin_step(step, slice(self._first + self._count, None))


def _key(text: str) -> bytes:
    """Return the numbers of 32 bits by which `random.seed` seeds from a text, after their count."""
    data = text.encode()
    data = (data + hashlib.sha512(data).digest())[::-1]
    return (-(-len(data) // 4)).to_bytes(4, "little") + data.ljust(KEY_BYTES, b"\0")
