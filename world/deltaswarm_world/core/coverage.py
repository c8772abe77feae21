"""The area of the arena that members of trees sense."""

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.arrays import Floats

COVERAGE_EVERY_S = 10.0
"""Interval of the coverage measure."""

COVERAGE_CELL_M = 1.0
"""Resolution of the coverage measure."""


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
        """Whether coverage is measured in this step."""
        return step % self._every == 0

    def area_m2(self, places_m: Floats) -> float:
        """Return the area of the union of sensing discs around positions (n, 2), within the arena [m2]."""
        if not len(places_m):
            return 0.0
        x_m, y_m = places_m[:, :1], places_m[:, 1:]
        columns = np.floor(x_m / COVERAGE_CELL_M).astype(np.int64) + self._around_x
        rows = np.floor(y_m / COVERAGE_CELL_M).astype(np.int64) + self._around_y
        dx, dy = (columns + 0.5) * COVERAGE_CELL_M - x_m, (rows + 0.5) * COVERAGE_CELL_M - y_m
        inside = dx * dx + dy * dy <= self._range_m2
        inside &= (columns >= 0) & (columns < self._cells[0]) & (rows >= 0) & (rows < self._cells[1])
        is_sensed = np.zeros(self._cells, dtype=np.bool_)
        is_sensed[columns[inside], rows[inside]] = True
        return float(np.count_nonzero(is_sensed)) * COVERAGE_CELL_M**2
