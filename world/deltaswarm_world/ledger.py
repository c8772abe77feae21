"""The ledger: what happened in each step, and what the agents' own frames show of their trees."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from deltaswarm_wire.radio import Attending, Member, RadioFrame, Relocating
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.truth import NOBODY
from deltaswarm_world.density import Floats

COVERAGE_EVERY_S = 10.0
"""Coverage is measured this often."""

COVERAGE_CELL_M = 1.0
"""Resolution of the coverage measure."""


Standing = tuple[str, int, int]
"""Role, level and parent of an agent, as its frame of this step shows."""

FREE: Standing = ("free", 0, NOBODY)
"""Of one that says nothing."""


def standing(frame: RadioFrame) -> Standing:
    """What a frame shows of its sender."""
    if type(frame) is Member:
        level = len(frame.path) - 1
        parent = frame.path[-2] if level else NOBODY
        return ("orphan" if frame.orphan else "member" if level else "root"), level, parent
    if type(frame) is Relocating:
        return "relocating", 0, NOBODY
    if type(frame) is Attending:
        return "attending", 0, NOBODY
    return "leaving", 0, NOBODY


def by_agent(counts: Mapping[int, int]) -> dict[str, int]:
    """Counts that are not 0, as JSON has them."""
    return {str(agent): count for agent, count in sorted(counts.items()) if count}


class Numbers:
    """The numbers of agents' messages of one kind, from 0 up by 1: they show what the fabric lost."""

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


class Coverage:
    """The area within sensing range of a tree's members, on a 1 m grid over the arena."""

    def __init__(self, scenario: Scenario) -> None:
        self._range_m2 = scenario.agents.sensing_range_m**2
        self._every = max(1, round(COVERAGE_EVERY_S / scenario.run.step_s))
        self._cells = (
            max(1, round(scenario.arena.width_m / COVERAGE_CELL_M)),
            max(1, round(scenario.arena.height_m / COVERAGE_CELL_M)),
        )
        reach = int(np.ceil(scenario.agents.sensing_range_m / COVERAGE_CELL_M)) + 1
        span = np.arange(-reach, reach + 1)
        self._around_x, self._around_y = (axis.ravel() for axis in np.meshgrid(span, span))

    def is_due(self, step: int) -> bool:
        """Whether this step is one in which coverage is measured."""
        return step % self._every == 0

    def area_m2(self, places_m: Floats) -> float:
        """Area of the union of the sensing discs around places (n, 2), within the arena [m2]."""
        if not len(places_m):
            return 0.0
        x_m, y_m = places_m[:, :1], places_m[:, 1:]
        columns = np.floor(x_m / COVERAGE_CELL_M).astype(np.int64) + self._around_x
        rows = np.floor(y_m / COVERAGE_CELL_M).astype(np.int64) + self._around_y
        dx, dy = (columns + 0.5) * COVERAGE_CELL_M - x_m, (rows + 0.5) * COVERAGE_CELL_M - y_m
        inside = dx * dx + dy * dy <= self._range_m2
        inside &= (columns >= 0) & (columns < self._cells[0]) & (rows >= 0) & (rows < self._cells[1])
        return float(np.unique((columns * self._cells[1] + rows)[inside]).size) * COVERAGE_CELL_M**2
