"""Make two stored results of every kind, and read them as the commands do."""

import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_cli.main import main
from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.inspect import info
from deltaswarm_orchestrator.recording import LAYOUT
from deltaswarm_orchestrator.recording.reader import read_recording
from deltaswarm_orchestrator.recording.replay import write_steps
from deltaswarm_orchestrator.results import resume
from deltaswarm_orchestrator.results.run_tables import write_csv
from deltaswarm_orchestrator.scenarios.load import load_scenario, to_toml
from deltaswarm_orchestrator.sweeps.folder import SweepFolder, SweepFolderError
from deltaswarm_orchestrator.sweeps.load import load_sweep
from deltaswarm_orchestrator.sweeps.table import read_series, read_table
from deltaswarm_scenario.person_tables import ProbeRow
from deltaswarm_sessions import roster
from deltaswarm_sessions.folder import attempts_at, check_design, folder_name, write_record
from deltaswarm_sessions.pilot import _read as read_pilot
from deltaswarm_sessions.plan import plan
from deltaswarm_sessions.session import Session
from deltaswarm_sessions.settings import load_session
from deltaswarm_sessions.tables import write_tables
from deltaswarm_studies.evidence import Evidence
from deltaswarm_studies.load import load_study
from tests.support.sessions import a_file
from tests.support.studying import OWN
from tests.support.swarms import COMMAND

FOUND = object()
"""What a reader returns if it says by itself that something is not whole."""

SHORT = ["--set", "run.duration_s=30", "--set", "run.step_s=0.5"]
STUDY = """
schema = 1
name = "own"
base = "smoke"
scenario.run.duration_s = 100.0
scenario.metrics.horizon_s = 50.0
sweep.seed = {}
sweep.repeats = 2
sweep.prove = 0
sweep.series_every_s = 50.0
sweep.axes."radio.loss" = [0.0, 0.9]
[[sweep.paired]]
label = ["decentralised", "hybrid"]
control.mode = ["decentralised", "hybrid"]
"""


class Store(NamedTuple):
    """A kind of stored result."""

    folder: Path
    other: Path
    """Another of the same kind, by another seed."""
    read: Callable[[Path], Any]
    """Reads a folder as commands do; raises, returns FOUND, or returns what it has read."""


def make_all(at: Path) -> dict[str, Store]:
    """Make two of each kind below a folder."""
    for name in ("a", "b"):
        (at / name).mkdir()
        _make(at / name, seed="1" if name == "a" else "2")
    first, second = at / "a", at / "b"
    jobs = load_sweep(str(first / "own.toml")).jobs()
    study = load_study(str(first / "own.toml"))

    def read_sweep(folder: Path) -> Any:
        SweepFolder(folder).check("own")
        results = [SweepFolder(folder).result(job) for job in jobs]
        manifest = seal.checked(folder / seal.MANIFEST)
        if "swept" not in manifest:  # as `deltaswarm report` does
            raise SweepFolderError("no sweep")
        tables = read_table(folder / "table.csv"), read_series(folder / "series.csv"), read_table(folder / "costs.csv")
        plan_of = load_sweep(str(folder / "sweep.toml")).jobs()
        return FOUND if None in results else [results, manifest, [job.key for job in plan_of], *map(_cells, tables)]

    def read_study(folder: Path) -> Any:
        evidence = Evidence.of_folder(study, folder)
        return [_cells(frame) for frame in (evidence.runs, evidence.courses, evidence.contrasts, evidence.estimates)]

    readers: dict[str, tuple[str, Callable[[Path], Any]]] = {
        "run": ("run", _read_run),
        "recording": ("run", _read_recording),
        "checkpoint": ("checkpoint", _read_checkpoint),
        "sweep": ("out/sweep", read_sweep),
        "study": ("out", read_study),
        "session": ("sessions", _read_sessions),
        "tables": ("tables", lambda folder: read_pilot(folder / "runs.tsv")),
    }
    return {kind: Store(first / name, second / name, read) for kind, (name, read) in readers.items()}


def _make(at: Path, seed: str) -> None:
    assert main(["run", "smoke", "--in-process", "-q", "--seed", seed, *SHORT, "--out", str(at / "run")]) == 0
    (at / "own.toml").write_text(STUDY.format(seed) + OWN.replace("100.0", "50.0"))
    assert main(["study", str(at / "own.toml"), "-j", "1", "-q", "--out", str(at / "out")]) in (0, 1, 3)
    for participant in (1, 2):
        _make_session(at, participant + 2 * (seed == "2"))
    roster.write(at / "sessions", roster.Roster((roster.Withdrawn(9, "2026-11-27", "by mail"),)))
    write_tables(at / "sessions", at / "tables")
    _make_checkpoint(at / "checkpoint", seed)


def _make_session(at: Path, participant: int) -> None:
    settings, beside = load_session(str(a_file(at, 2)))
    session = Session(participant, plan(settings, participant, beside), kept={"begun": "2026-11-27T09:00:00+00:00"})
    folder = at / "sessions" / folder_name(participant)
    for run in session.runs:
        (at / "planned.toml").write_text(to_toml(run.scenario))
        assert main(["run", str(at / "planned.toml"), "--in-process", "-q", "--out", str(folder / run.folder)]) == 0
        page = folder / f"{run.folder}.again-1"
        page.mkdir()
        row = ProbeRow("trust", 0, "why", "it was quick", 60.0, None, answered_utc="2026-11-27T10:00:00.000Z")
        write_csv(page / "probes.csv", ProbeRow._fields, [row])
        session.attempts[run.folder] = attempts_at(folder, run)
    write_record(folder, session)


def _make_checkpoint(folder: Path, seed: str) -> None:
    """Let a run of processes end early, but in order, after a checkpoint."""
    options = ["--seed", seed, "--set", "run.duration_s=50000", "--checkpoint", "20", "-q", "--out", str(folder)]
    with subprocess.Popen([*COMMAND, "run", "smoke", *options], stderr=subprocess.DEVNULL) as run:
        newest = folder.with_name(f"{folder.name}.part") / "checkpoint" / "newest.json"
        while not newest.exists():
            assert run.poll() is None
            time.sleep(0.1)
        run.send_signal(signal.SIGTERM)


def _read_run(folder: Path) -> Any:
    described = info.describe(folder)
    steps = folder.with_name("steps.msgpack")
    write_steps(folder, steps)
    named = sorted({*described["files"]} - {LAYOUT})  # which no command reads
    return {**described, "files": named}, steps.read_bytes()


def _read_recording(folder: Path) -> Any:
    recording = read_recording(folder)
    return asdict(recording) if recording.complete else FOUND


def _read_checkpoint(folder: Path) -> Any:
    scenario = load_scenario(str(folder / "scenario.toml"))
    resume.check_inputs(folder, scenario)
    return resume.newest(folder), info.describe(folder)["summary"]


def _read_sessions(folder: Path) -> Any:
    if roster.doubt(folder):
        return FOUND
    settings, beside = load_session(str(folder.parent / "deltas.toml"))
    for participant in (1, 2):
        here = folder / folder_name(participant)
        session = Session(participant, plan(settings, participant, beside))
        seal.checked(here / "session.json")
        for run in session.runs:
            session.attempts[run.folder] = attempts_at(here, run)
        check_design(here, session)
    out = folder.with_name("tables-again")
    return [file.read_bytes() for file in write_tables(folder, out)]


def _cells(frame: Any) -> str:
    return str(frame.to_csv(index=False))
