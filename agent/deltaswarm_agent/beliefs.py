"""What a tree member believes about events: the paper's E_i, from its sensor and its tree's frames."""

from collections.abc import Sequence

from deltaswarm_wire.messages import Event
from deltaswarm_wire.radio import MAX_EVENTS, MAX_GONE, Gone, Sighting

MEMORY_STEPS = 12
"""An event is forgotten when nobody of the tree has sensed it for so long; longer memory breeds ghosts."""

GONE_STEPS = 30
"""For so long it is told that an event is gone."""

GONE_MARGIN_M = 0.05
"""An event this far within sensing range, and not sensed, is gone: places are rounded to centimetres."""


def to_cm(metres: float) -> int:
    """Metres as whole centimetres, as they go on the air."""
    return round(metres * 100.0)


class Beliefs:
    """Known events, each with the step in which it was last sensed; the freshest word wins."""

    def __init__(self, sensing_range_m: float) -> None:
        self._near_m2 = max(0.0, sensing_range_m - GONE_MARGIN_M) ** 2
        self._seen: dict[int, tuple[int, int, int]] = {}
        self._gone: dict[int, int] = {}

    def sense(self, events: Sequence[Event], x_m: float, y_m: float, now: int) -> None:
        """Take in what the own sensor shows at a place, and what it fails to show."""
        for event, ex_m, ey_m in events:
            self._seen[event] = (to_cm(ex_m), to_cm(ey_m), now)
            self._gone.pop(event, None)
        missing = [
            event
            for event, (x_cm, y_cm, seen) in self._seen.items()
            if seen != now and (x_cm * 0.01 - x_m) ** 2 + (y_cm * 0.01 - y_m) ** 2 < self._near_m2
        ]
        for event in missing:
            del self._seen[event]
            self._gone[event] = now

    def hear(self, events: Sequence[Sighting], gone: Sequence[Gone], now: int) -> None:
        """Take in what a member of the same tree said one step ago."""
        sent = now - 1
        for event, x_cm, y_cm, age in events:
            step = sent - age
            known = self._seen.get(event)
            if (known is None or step > known[2]) and self._gone.get(event, -1) < step:
                self._seen[event] = (x_cm, y_cm, step)
                self._gone.pop(event, None)
        for event, age in gone:
            step = sent - age
            known = self._seen.get(event)
            if known is not None and known[2] < step:
                del self._seen[event]
            if known is None or known[2] < step:
                self._gone[event] = max(step, self._gone.get(event, -1))

    def forget(self, now: int) -> None:
        """Drop what is too old to be believed, or to be told."""
        old = [event for event, (_, _, seen) in self._seen.items() if now - seen > MEMORY_STEPS]
        for event in old:
            del self._seen[event]
        old = [event for event, step in self._gone.items() if now - step > GONE_STEPS]
        for event in old:
            del self._gone[event]

    def active(self) -> list[Event]:
        """The events believed to be there, by id."""
        return [Event(event, x_cm / 100, y_cm / 100) for event, (x_cm, y_cm, _) in sorted(self._seen.items())]

    def __bool__(self) -> bool:
        return bool(self._seen)

    def sightings(self, now: int) -> tuple[Sighting, ...]:
        """The freshest of them, as they go on the air."""
        rows = [Sighting(event, x_cm, y_cm, now - seen) for event, (x_cm, y_cm, seen) in self._seen.items()]
        if len(rows) > MAX_EVENTS:
            rows.sort(key=lambda row: (row.age, row.event))
        return tuple(rows[:MAX_EVENTS])

    def departures(self, now: int) -> tuple[Gone, ...]:
        """The events most freshly found missing, as they go on the air."""
        rows = [Gone(event, now - step) for event, step in self._gone.items()]
        if len(rows) > MAX_GONE:
            rows.sort(key=lambda row: (row.age, row.event))
        return tuple(rows[:MAX_GONE])
