"""The area of the arena that members of trees sense."""

import numpy as np

from deltaswarm_scenario.scenario import Scenario
from deltaswarm_world.core.arrays import Floats

COVERAGE_EVERY_S = 10.0
"""Interval of the coverage measure."""


class Coverage:
    """The area within sensing range of a tree's members, on a 1 m grid over the arena."""

    def __init__(self, scenario: Scenario) -> None:
        self._range_m = scenario.agents.sensing_range_m
        self._every = max(1, round(COVERAGE_EVERY_S / scenario.run.step_s))
        self._cells = max(1, round(scenario.arena.width_m)), max(1, round(scenario.arena.height_m))
        self._centres_m = tuple(np.arange(count) + 0.5 for count in self._cells)

    def is_due(self, step: int) -> bool:
        """Whether coverage is measured in this step."""
        return step % self._every == 0

    def area_m2(self, places_m: Floats) -> float:
        """Return the area of the union of sensing discs around positions (n, 2), within the arena [m2]."""
        is_sensed, range_m = np.zeros(self._cells, dtype=np.bool_), self._range_m
        (x_centres_m, y_centres_m), range_m2 = self._centres_m, range_m**2
        for x_m, y_m in places_m.tolist():
            columns = slice(int(max(0.0, x_m - range_m)), int(x_m + range_m) + 1)
            rows = slice(int(max(0.0, y_m - range_m)), int(y_m + range_m) + 1)
            dx, dy = x_centres_m[columns] - x_m, y_centres_m[rows] - y_m
            is_sensed[columns, rows] |= (dx * dx)[:, None] + dy * dy <= range_m2
        return float(np.count_nonzero(is_sensed))
