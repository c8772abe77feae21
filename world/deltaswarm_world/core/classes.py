"""Classes of events, and the jumps of their sensed places by which the person at the station can tell them apart."""

from math import floor

import numpy as np

from deltaswarm_scenario.task import TaskSettings
from deltaswarm_wire.messages import Event
from deltaswarm_world.core.arrays import Floats
from deltaswarm_world.core.chance import generator

CLASS_STREAM, JUMP_STREAM = 5, 6


class EventClasses:
    """The class of each event, and where it is sensed. All follows from seed, event and time, so nothing is saved."""

    def __init__(self, task: TaskSettings, seed: int, size_m: Floats) -> None:
        self._task, self._seed, self._size_m = task, seed, size_m
        self._jumps_m: dict[int, float] = {}

    def is_target(self, event: int) -> bool:
        """Whether an event is a target."""
        return bool(generator(self._seed, CLASS_STREAM, event).random() < self._task.target_share)

    def interval(self, time_s: float) -> int:
        """Return the number of the interval in which sensed places stay the same."""
        return floor(time_s / self._task.jump_every_s + 1e-9)

    def as_sensed(self, event: int, x_m: float, y_m: float, interval: int) -> Event:
        """Return an event at the place where it is sensed in an interval, within the arena."""
        if event not in self._jumps_m:
            self._jumps_m[event] = self._task.target_jump_m if self.is_target(event) else self._task.decoy_jump_m
        error_m = self._jumps_m[event] * generator(self._seed, JUMP_STREAM, event, interval).standard_normal(2)
        place_m = np.minimum(np.maximum(error_m + np.array((x_m, y_m)), 0.0), self._size_m)
        return Event(event, *place_m.tolist())
