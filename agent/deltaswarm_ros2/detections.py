"""Events from a robot's detections, which have positions but no numbers. Positions in m, arena frame."""

import math
from collections.abc import Iterable

from deltaswarm_wire.checked import Problem, SettingsError
from deltaswarm_wire.codec import MAX_ID
from deltaswarm_wire.messages import MAX_SENSED, Event

Place = tuple[float, float]


class Detections:
    """The detections of the last `lost_s`, numbered by the cell of the arena in which they were first made.

    Agents thus give the same number to what they detect in the same cell. A detection within half a cell of an event
    is this event, so that noise on the border of two cells does not make two of one.
    """

    def __init__(self, width_m: float, height_m: float, cell_m: float, range_m: float, lost_s: float) -> None:
        self._size_m = (width_m, height_m)
        self._cell_m = cell_m
        self._columns = math.ceil(width_m / cell_m)
        if self._columns * math.ceil(height_m / cell_m) > MAX_ID:
            allowed = f"must divide the arena into at most {MAX_ID} cells"
            raise SettingsError([Problem("body.options.detections_cell_m", f"{cell_m:g}", allowed)])
        self._range_m = range_m
        self._lost_s = lost_s
        self._seen: dict[int, tuple[Place, float]] = {}
        """The newest position of each event, and when it was detected [s]."""

    def take(self, places: Iterable[Place], robot: Place, now_s: float) -> None:
        """Take what a robot detects now. What is outside the arena or its sensing range is ignored."""
        self._seen = {event: seen for event, seen in self._seen.items() if now_s - seen[1] <= self._lost_s}
        for place in places:
            is_inside = all(0.0 <= at_m < size_m for at_m, size_m in zip(place, self._size_m, strict=True))
            if is_inside and math.dist(place, robot) <= self._range_m and len(self._seen) < MAX_SENSED:
                self._seen[self._number(place)] = (place, now_s)

    def events(self, now_s: float) -> tuple[Event, ...]:
        return tuple(
            Event(event, *place) for event, (place, at_s) in self._seen.items() if now_s - at_s <= self._lost_s
        )

    def _number(self, place: Place) -> int:
        known = min(self._seen, key=lambda event: math.dist(self._seen[event][0], place), default=None)
        if known is not None and math.dist(self._seen[known][0], place) <= self._cell_m / 2:
            return known
        return int(place[1] / self._cell_m) * self._columns + int(place[0] / self._cell_m)
