"""CSV: `poses.csv` (a row per view and agent), `events.csv` (per event), `workload.csv` (per step)."""

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.export.snapshots import Film
from deltaswarm_wire.messages import NOBODY
from deltaswarm_wire.operator_messages import Workload
from deltaswarm_wire.truth import Body, EventState


def write(film: Film, out: Path) -> None:
    """A folder with the three tables; a cell is empty where there is no time yet, no parent or no root."""
    out.mkdir()
    poses = (
        (view.step, view.time_s, *body[:-2], *("" if agent == NOBODY else agent for agent in body[-2:]))
        for view in film.snapshots()
        for body in view.bodies
    )
    _write(out / "poses.csv", ("step", "time_s", *Body._fields), poses)
    _write(out / "events.csv", EventState._fields, film.figures.events)
    _write(out / "workload.csv", Workload._fields, film.figures.workloads)


def _write(file: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    with file.open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(header)
        table.writerows(rows)
