"""Events from a file, for bodies without a world. Boards with the same file have the same events.

The file is CSV with a header: `event,x_m,y_m` and optionally `from_s,until_s,work_s`. An event exists from `from_s` to
`until_s` by the agent's clock, or until this agent has observed it for `work_s`. Boards do not exchange completed
work: `until_s` ends an event for all boards, `work_s` for each board separately.
"""

import math
import os
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import NamedTuple

from deltaswarm_wire.checked import Problem
from deltaswarm_wire.codec import MAX_ABS_M, MAX_ID
from deltaswarm_wire.messages import MAX_SENSED, Event
from deltaswarm_wire.reading import read_text, rows_of

_NEEDED = ("event", "x_m", "y_m")
_OPTIONAL = ("from_s", "until_s", "work_s")
MAX_ROWS, MAX_BYTES = 10_000, 2_000_000


class ScheduledEvent(NamedTuple):
    """One row. Position in m, arena frame; times in s by the agent's clock; work in s of its observation."""

    event: int
    x_m: float
    y_m: float
    from_s: float = 0.0
    until_s: float = math.inf
    work_s: float = math.inf


def read_events(text: str) -> tuple[ScheduledEvent, ...]:
    """Read the rows of an events file."""
    names, lines_of_rows = rows_of(text)
    unknown = [name for name in names if name not in _NEEDED + _OPTIONAL]
    if unknown or any(name not in names for name in _NEEDED):
        rule = f"must be {', '.join(_NEEDED)} and optionally {', '.join(_OPTIONAL)}"
        raise ValueError(f"line 1: columns {rule} (got {', '.join(names) or 'none'})")
    rows: dict[int, ScheduledEvent] = {}
    for line, row in lines_of_rows:
        entry = _scheduled_event(row, line)
        if entry.event in rows:
            raise ValueError(f"line {line}: event must be unique (got {entry.event} again)")
        if len(rows) >= MAX_ROWS:
            raise ValueError(f"line {line}: events must be at most {MAX_ROWS}")
        rows[entry.event] = entry
    return tuple(rows.values())


def _scheduled_event(row: dict[str, str], line: int) -> ScheduledEvent:
    def number(name: str, low: float, high: float, default: float = math.nan) -> float:
        text = row.get(name)
        try:
            value = float(text) if text else default
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise ValueError(f"line {line}: {name} must be a number from {low:.15g} to {high:.15g} (got {text!r})")
        return value

    event = number("event", 0, MAX_ID)
    if event != int(event):
        raise ValueError(f"line {line}: event must be an integer (got {row['event']!r})")
    scheduled = ScheduledEvent(
        int(event),
        number("x_m", -MAX_ABS_M, MAX_ABS_M),
        number("y_m", -MAX_ABS_M, MAX_ABS_M),
        number("from_s", 0.0, math.inf, 0.0),
        number("until_s", 0.0, math.inf, math.inf),
        number("work_s", 0.0, math.inf, math.inf),
    )
    if scheduled.until_s <= scheduled.from_s:
        raise ValueError(
            f"line {line}: until_s must be above from_s, {scheduled.from_s:.15g} s (got {scheduled.until_s:.15g})"
        )
    return scheduled


class EventField:
    def __init__(self, scheduled: Iterable[ScheduledEvent], sensing_range_m: float) -> None:
        self._scheduled = {entry.event: entry for entry in scheduled}
        self._reach_m2 = sensing_range_m**2
        self._done_s: dict[int, float] = {}

    def _near(self, x_m: float, y_m: float, time_s: float) -> list[ScheduledEvent]:
        return [
            h
            for h in self._scheduled.values()
            if h.from_s <= time_s < h.until_s
            and (h.x_m - x_m) ** 2 + (h.y_m - y_m) ** 2 <= self._reach_m2
            and self._done_s.get(h.event, 0.0) < h.work_s
        ]

    def observe(self, observed: Collection[int], x_m: float, y_m: float, time_s: float, for_s: float) -> None:
        """Work for `for_s` [s] from (x_m, y_m) on the observed events that are in range."""
        for entry in self._near(x_m, y_m, time_s) if observed else ():
            if entry.event in observed:
                self._done_s[entry.event] = self._done_s.get(entry.event, 0.0) + for_s

    def sensed(self, x_m: float, y_m: float, time_s: float, believed: tuple[float, float]) -> tuple[Event, ...]:
        """Return the events in range of the true position (x_m, y_m) [m], shifted by the error of the believed one."""
        dx_m, dy_m = believed[0] - x_m, believed[1] - y_m
        near = self._near(x_m, y_m, time_s)[:MAX_SENSED]
        return tuple(Event(h.event, h.x_m + dx_m, h.y_m + dy_m) for h in near)


def event_field(file: str, sensing_range_m: float) -> EventField:
    """Read the events file for one agent; without a file there are no events."""
    if not file:
        return EventField((), sensing_range_m)
    if not os.path.isfile(file) or os.path.getsize(file) > MAX_BYTES:
        raise ValueError(f"must be an existing file of at most {MAX_BYTES} bytes")
    return EventField(read_events(read_text(Path(file))), sensing_range_m)


def file_problems(file: str) -> list[Problem]:
    try:
        event_field(file, 1.0)
    except (OSError, ValueError) as error:
        return [Problem("events", repr(file), str(error))]
    return []
