"""The ledger: what happened in each step, and what the agents' own frames show of their trees."""

import numpy as np

from deltaswarm_wire.radio import Attending, Leaving, Member, RadioFrame, Relocating
from deltaswarm_wire.settings import Scenario
from deltaswarm_wire.truth import IN_TREE, NOBODY
from deltaswarm_world.density import Floats

COVERAGE_EVERY_S = 10.0
"""Coverage is measured this often."""

COVERAGE_CELL_M = 1.0
"""Resolution of the coverage measure."""


def standing(frame: RadioFrame | None) -> tuple[str, int, int]:
    """Role, level and parent that an agent's frame of this step shows."""
    if type(frame) is Member:
        level = len(frame.path) - 1
        parent = frame.path[-2] if level else NOBODY
        return ("orphan" if frame.orphan else "member" if level else "root"), level, parent
    if type(frame) is Relocating:
        return "relocating", 0, NOBODY
    if type(frame) is Attending:
        return "attending", 0, NOBODY
    if type(frame) is Leaving:
        return "leaving", 0, NOBODY
    return "free", 0, NOBODY


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
        self._around = np.stack(np.meshgrid(span, span), axis=-1).reshape(1, -1, 2)

    def is_due(self, step: int) -> bool:
        """Whether this step is one in which coverage is measured."""
        return step % self._every == 0

    def area_m2(self, places_m: Floats) -> float:
        """Area of the union of the sensing discs around places (n, 2), within the arena [m2]."""
        if not len(places_m):
            return 0.0
        cells = np.floor(places_m / COVERAGE_CELL_M).astype(np.int64)[:, None, :] + self._around
        offsets = (cells + 0.5) * COVERAGE_CELL_M - places_m[:, None, :]
        inside = np.einsum("ijk,ijk->ij", offsets, offsets) <= self._range_m2
        inside &= np.all((cells >= 0) & (cells < self._cells), axis=-1)
        seen = cells[inside]
        return float(np.unique(seen[:, 0] * self._cells[1] + seen[:, 1]).size) * COVERAGE_CELL_M**2


def is_in_tree(role: str) -> bool:
    """Whether an agent of this role counts as part of a tree."""
    return role in IN_TREE
