"""Runs that were cut off by a kill: their journals, and whether this version can go on with them."""

import json
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from deltaswarm_orchestrator.base.inputs import Inputs, identify
from deltaswarm_orchestrator.run.journal import Header, Journal, Row
from deltaswarm_sessions.plan import PlannedRun
from deltaswarm_wire.checked import plain

Left = tuple[Header, tuple[Row, ...]]


def journal_of(folder: Path, run: PlannedRun) -> Path:
    """Return the journal of a run in a participant's folder."""
    return folder / f"{run.folder}.journal"


def identity_of(run: PlannedRun, inputs: Inputs, speed: float) -> str:
    """Return a digest of what decides a run besides what is put in: scenario, code, files, pace."""
    told = [plain(run.scenario), inputs, speed]
    return sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()


def left(folder: Path, run: PlannedRun) -> Left | None:
    """Return what is left of a run that was cut off; remove a journal whose run has ended."""
    if (found := Journal.read(journal_of(folder, run))) is None:
        return None
    if (folder / found[0].run).exists():
        journal_of(folder, run).unlink()
        return None
    return found


def cannot_go_on(folder: Path, runs: Sequence[PlannedRun], speed: float) -> list[str]:
    """Return the runs of a participant that were begun by other code or files, and so would not repeat."""
    cut_off = {run.folder: found for run in runs if (found := left(folder, run))}
    return [
        run.folder
        for run in runs
        if run.folder in cut_off and cut_off[run.folder][0].identity != identity_of(run, identify(run.scenario), speed)
    ]
