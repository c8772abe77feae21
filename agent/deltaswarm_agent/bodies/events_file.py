"""Events from a file, for bodies without a world: boards with the same file are in the same surroundings.

A CSV with a header: `event,x_m,y_m` and, where wanted, `from_s,until_s,work_s`. An event is there from `from_s` to
`until_s` of the agent's own time, or until this agent has observed it for `work_s`. Boards do not tell one another
of work done: with an `until_s` an event ends for all of them, else for each by its own observation.
"""

import csv
import math
import os
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import NamedTuple

from deltaswarm_wire.checked import Problem
from deltaswarm_wire.codec import MAX_ABS_M, MAX_ID
from deltaswarm_wire.messages import MAX_SENSED, Event

_NEEDED = ("event", "x_m", "y_m")
_OPTIONAL = ("from_s", "until_s", "work_s")
MAX_ROWS, MAX_BYTES = 10_000, 2_000_000


class Happening(NamedTuple):
    """One row. Place in m, arena frame; times in s of the agent's own clock; work in s of its observation."""

    event: int
    x_m: float
    y_m: float
    from_s: float = 0.0
    until_s: float = math.inf
    work_s: float = math.inf


def read_events(lines: Iterable[str]) -> tuple[Happening, ...]:
    """The rows of an events file.

    Raises:
        ValueError: what is wrong, with its line.
    """
    reader = csv.DictReader(lines)
    try:
        return _happenings(reader)
    except csv.Error as error:
        raise ValueError(f"line {reader.line_num + 1}: {error}") from None


def _happenings(reader: "csv.DictReader[str]") -> tuple[Happening, ...]:
    names = tuple(reader.fieldnames or ())
    unknown = [name for name in names if name not in _NEEDED + _OPTIONAL]
    if unknown or any(name not in names for name in _NEEDED):
        allowed = f"{', '.join(_NEEDED)} and, where wanted, {', '.join(_OPTIONAL)} are allowed"
        raise ValueError(f"line 1: columns {', '.join(names) or 'none'}; {allowed}")
    rows: dict[int, Happening] = {}
    for row in reader:
        if None in row:
            raise ValueError(f"line {reader.line_num}: more columns than the header's {len(names)}")
        happening = _happening(row, reader.line_num)
        if happening.event in rows:
            raise ValueError(f"line {reader.line_num}: event {happening.event} is there already")
        if len(rows) >= MAX_ROWS:
            raise ValueError(f"line {reader.line_num}: at most {MAX_ROWS} events are allowed")
        rows[happening.event] = happening
    return tuple(rows.values())


def _happening(row: dict[str | None, str | None], line: int) -> Happening:
    def number(name: str, low: float, high: float, default: float = math.nan) -> float:
        text = row.get(name)
        try:
            value = float(text) if text else default
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise ValueError(f"line {line}: {name} is {text!r}; a number from {low:g} to {high:g} is allowed")
        return value

    event = number("event", 0, MAX_ID)
    if event != int(event):
        raise ValueError(f"line {line}: event is {row['event']!r}; an integer is allowed")
    made = Happening(
        int(event),
        number("x_m", -MAX_ABS_M, MAX_ABS_M),
        number("y_m", -MAX_ABS_M, MAX_ABS_M),
        number("from_s", 0.0, math.inf, 0.0),
        number("until_s", 0.0, math.inf, math.inf),
        number("work_s", 0.0, math.inf, math.inf),
    )
    if made.until_s <= made.from_s:
        raise ValueError(f"line {line}: until_s is {made.until_s:g}; above from_s ({made.from_s:g}) is allowed")
    return made


class Surroundings:
    """The events of a file as one agent meets them."""

    def __init__(self, happenings: Iterable[Happening], sensing_range_m: float) -> None:
        self._happenings = {happening.event: happening for happening in happenings}
        self._reach_m2 = sensing_range_m**2
        self._done_s: dict[int, float] = {}

    def _near(self, x_m: float, y_m: float, time_s: float) -> list[Happening]:
        return [
            h
            for h in self._happenings.values()
            if h.from_s <= time_s < h.until_s
            and (h.x_m - x_m) ** 2 + (h.y_m - y_m) ** 2 <= self._reach_m2
            and self._done_s.get(h.event, 0.0) < h.work_s
        ]

    def observe(self, observed: Collection[int], x_m: float, y_m: float, time_s: float, for_s: float) -> None:
        """Work for `for_s` [s] from (x_m, y_m) on those that are in range, whatever the agent claims."""
        for happening in self._near(x_m, y_m, time_s) if observed else ():
            if happening.event in observed:
                self._done_s[happening.event] = self._done_s.get(happening.event, 0.0) + for_s

    def sensed(self, x_m: float, y_m: float, time_s: float, believed: tuple[float, float]) -> tuple[Event, ...]:
        """What is in range of (x_m, y_m), the true place [m]; seen from the believed one, so it has its error."""
        dx_m, dy_m = believed[0] - x_m, believed[1] - y_m
        near = self._near(x_m, y_m, time_s)[:MAX_SENSED]
        return tuple(Event(h.event, h.x_m + dx_m, h.y_m + dy_m) for h in near)


def surroundings(file: str, sensing_range_m: float) -> Surroundings:
    """What the file holds, for one agent; no file: nothing.

    Raises:
        OSError, ValueError: it cannot be read.
    """
    if not file:
        return Surroundings((), sensing_range_m)
    if not os.path.isfile(file) or os.path.getsize(file) > MAX_BYTES:
        raise ValueError(f"a file of at most {MAX_BYTES} bytes that is there is allowed")
    text = Path(file).read_text("utf-8-sig")  # spreadsheets put a mark before the header that no one sees
    return Surroundings(read_events(text.splitlines()), sensing_range_m)


def file_problems(file: str) -> list[Problem]:
    """What is wrong with the file of the option `events`."""
    try:
        surroundings(file, 1.0)
    except (OSError, ValueError) as error:
        return [Problem("events", repr(file), str(error))]
    return []
