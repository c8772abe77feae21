"""The world's files in the run folder: `world.csv`, `events.csv`, `world.json`."""

import csv
import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from deltaswarm_scenario.truth import COLUMNS, EventState, StepRecord
from deltaswarm_world.core.world import WorldCore

FLUSH_EVERY_S = 1.0

EVENTS_SO_FAR = "world-events.csv"
"""A row for each change of an event; the newest counts. `events.csv` replaces it at the end."""


TABLES = ("world.csv", EVENTS_SO_FAR)


def has_steps(folder: Path) -> bool:
    """Whether a folder has a world's table with a step; one without is of a run that did not begin."""
    file = folder / TABLES[0]
    return file.exists() and len(file.read_bytes().splitlines()) > 1


class WorldOutput:
    """Writes one row per closed step, which a killed world leaves behind, and totals at the end.

    `columns` are those of a row. With `table_bytes` it continues tables of these lengths from a checkpoint, after
    `wall_s` of the run.
    """

    def __init__(
        self, folder: Path, columns: Iterable[str] = COLUMNS, table_bytes: Sequence[int] = (), wall_s: float = 0.0
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._handle = os.open(folder, os.O_RDONLY)
        self._folder = Path(f"/proc/self/fd/{self._handle}")
        """The folder by its handle, even if it is moved: by name, a leftover world might write into another run."""
        for name, size in zip(TABLES, table_bytes, strict=False):
            os.truncate(folder / name, size)
        self._files = [
            (folder / name).open("a" if table_bytes else "w", newline="", encoding="utf-8") for name in TABLES
        ]
        self._rows, self._events = (csv.writer(file) for file in self._files)
        if not table_bytes:
            self._rows.writerow(columns)
            self._events.writerow(EventState._fields)
        self._wall_before_s = wall_s
        self._flush_due = time.monotonic() + FLUSH_EVERY_S
        self._started = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._handle)
        for file in self._files:
            file.close()

    def write(self, record: StepRecord, changed: Iterable[EventState]) -> None:
        self._rows.writerow(record.values())
        self._events.writerows(changed)
        now = time.monotonic()
        if now >= self._flush_due:
            self._flush_due = now + FLUSH_EVERY_S
            self._flush()

    def _flush(self) -> None:
        for file in self._files:
            file.flush()

    def started(self) -> None:
        """Start the run's wall time with the first step."""
        self._started = time.monotonic()

    @property
    def wall_s(self) -> float:
        return self._wall_before_s + time.monotonic() - self._started

    def sync(self) -> list[int]:
        """Force all rows to disk; return the lengths of the tables [bytes]."""
        self._flush()
        for file in self._files:
            os.fsync(file.fileno())
        return [file.tell() for file in self._files]

    def finish(
        self,
        core: WorldCore,
        complete: bool,
        overruns: int,
        *,
        may_resume: bool = False,
        timed: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """Write events and totals; `world.json` last and atomically. A run that `may_resume` keeps all its tables."""
        self._flush()
        wall_s = self.wall_s
        with (self._folder / "events.csv").open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(EventState._fields)
            rows.writerows(core.environment.states())
        if complete and not may_resume:
            (self._folder / EVENTS_SO_FAR).unlink()
        totals = core.totals(complete) | {"wall_s": wall_s, "realtime_overruns": overruns, **timed}
        part = self._folder / "world.json.part"
        part.write_text(json.dumps(totals, indent=2) + "\n", encoding="utf-8")
        part.rename(self._folder / "world.json")
