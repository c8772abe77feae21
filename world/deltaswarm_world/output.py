"""What the world leaves in the run folder: `world.csv`, `events.csv`, `world.json`."""

import csv
import json
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from deltaswarm_wire.truth import EventState, Tally
from deltaswarm_world.core import WorldCore

FLUSH_EVERY_S = 1.0


class WorldOutput:
    """One row per step as it is closed, so that a killed world leaves what it had; totals at the end."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file = (folder / "world.csv").open("w", newline="")
        self._rows = csv.writer(self._file)
        self._rows.writerow(Tally._fields)
        self._flush_due = time.monotonic() + FLUSH_EVERY_S
        self._started = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def write(self, tally: Tally) -> None:
        """One closed step."""
        self._rows.writerow(tally)
        now = time.monotonic()
        if now >= self._flush_due:
            self._flush_due = now + FLUSH_EVERY_S
            self._file.flush()

    def started(self) -> None:
        """The first step begins: the run's wall time counts from here."""
        self._started = time.monotonic()

    def finish(self, core: WorldCore, complete: bool, overruns: int) -> None:
        """Events and totals; `world.json` appears last and whole."""
        self._file.flush()
        wall_s = time.monotonic() - self._started
        with (self._folder / "events.csv").open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(EventState._fields)
            rows.writerows(core.environment.states())
        totals = core.totals(complete) | {"wall_s": wall_s, "realtime_overruns": overruns}
        part = self._folder / "world.json.part"
        part.write_text(json.dumps(totals, indent=2) + "\n")
        part.rename(self._folder / "world.json")
