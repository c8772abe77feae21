"""A tree member's knowledge of events: the paper's E_i, from its sensor and its tree's frames."""

from deltaswarm_agent.controllers.paper.frames import MAX_EVENTS, MAX_GONE, Gone, Member, PaperFrame, Sighting, sighting
from deltaswarm_agent.controllers.paper.timers import Timers
from deltaswarm_wire.messages import Event

GONE_MARGIN_M = 0.05
"""An event this far within sensing range, and not sensed, is gone: positions are rounded to centimetres."""


def to_cm(metres: float) -> int:
    """Round metres to whole centimetres, as in frames."""
    return round(metres * 100.0)


class Beliefs:
    """Events by the freshest information about each: seen at a position in some step, or found missing."""

    def __init__(self, sensing_range_m: float, timers: Timers) -> None:
        self._memory, self._gone = timers.memory, timers.gone
        self._near_cm2 = (100.0 * max(0.0, sensing_range_m - GONE_MARGIN_M)) ** 2
        self._last_update_step: dict[int, int] = {}
        """Step of the freshest information about each event, present or gone."""
        self._places: dict[int, tuple[int, int]] = {}
        """Positions of the events believed present [cm]."""

    def sense(self, events: tuple[Event, ...], x_m: float, y_m: float, now: int) -> None:
        """Take the own sensor's events at a position, and the missing ones."""
        last_update, places = self._last_update_step, self._places
        for event, ex_m, ey_m in events:
            last_update[event] = now
            places[event] = (to_cm(ex_m), to_cm(ey_m))
        x_cm, y_cm, near_cm2 = 100.0 * x_m, 100.0 * y_m, self._near_cm2
        missing = [
            event
            for event, place in places.items()
            if last_update[event] != now and (place[0] - x_cm) ** 2 + (place[1] - y_cm) ** 2 < near_cm2
        ]
        for event in missing:
            last_update[event] = now
            del places[event]

    def hear(self, events: tuple[Sighting, ...], gone: tuple[Gone, ...], now: int) -> None:
        """Take the frame of a tree member from one step ago; fresher information wins."""
        sent = now - 1
        last_update, places = self._last_update_step, self._places
        for event, x_cm, y_cm, age in events:
            step = sent - age
            if last_update.get(event, -1) < step:
                last_update[event] = step
                places[event] = (x_cm, y_cm)
        for event, age in gone:
            step = sent - age
            if last_update.get(event, -1) < step:
                last_update[event] = step
                places.pop(event, None)

    def hear_tree(self, heard: list[PaperFrame], root: int, now: int) -> None:
        for frame in heard:
            if type(frame) is Member and frame.path[0] == root:
                self.hear(frame.events, frame.gone, now)

    def forget(self, now: int) -> None:
        """Drop information that is too old to use or to send."""
        last_update, places = self._last_update_step, self._places
        old = [event for event, step in last_update.items() if now - step > self._memory]
        for event in old:
            if event in places or now - last_update[event] > self._gone:
                del last_update[event]
                places.pop(event, None)

    def active(self) -> list[Event]:
        """The events believed present, by id."""
        return [Event(event, x_cm / 100, y_cm / 100) for event, (x_cm, y_cm) in sorted(self._places.items())]

    def __bool__(self) -> bool:
        return bool(self._places)

    def sightings(self, now: int) -> tuple[Sighting, ...]:
        last_update = self._last_update_step
        rows = [sighting((event, x_cm, y_cm, now - last_update[event])) for event, (x_cm, y_cm) in self._places.items()]
        if len(rows) > MAX_EVENTS:
            rows.sort(key=lambda row: (row.age, row.event))
            del rows[MAX_EVENTS:]
        return tuple(rows)

    def departures(self, now: int) -> tuple[Gone, ...]:
        """The events most recently found missing, as in frames."""
        places = self._places
        if len(places) == len(self._last_update_step):
            return ()
        rows = [Gone(event, now - step) for event, step in self._last_update_step.items() if event not in places]
        if len(rows) > MAX_GONE:
            rows.sort(key=lambda row: (row.age, row.event))
            del rows[MAX_GONE:]
        return tuple(rows)
