"""Export CSV: `poses.csv` (a row per view and agent), `events.csv` (per event), `workload.csv` (per step)."""

from pathlib import Path

from deltaswarm_orchestrator.export.snapshots import Film
from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_scenario.truth import Body, EventState
from deltaswarm_wire.messages import NOBODY
from deltaswarm_wire.operator_messages import Workload


def write(film: Film, out: Path) -> None:
    """Write a folder with the three tables; a cell is empty where there is no time yet, no parent or no root."""
    out.mkdir()
    poses = (
        (view.step, view.time_s, *("" if value == NOBODY and type(value) is int else value for value in body))
        for view in film.snapshots()
        for body in view.bodies
    )
    write_csv(out / "poses.csv", ("step", "time_s", *Body._fields), poses)
    write_csv(out / "events.csv", EventState._fields, film.recording.events)
    write_csv(out / "workload.csv", Workload._fields, film.recording.workloads)
