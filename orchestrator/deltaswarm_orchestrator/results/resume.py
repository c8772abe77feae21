"""Resume an interrupted run from its newest checkpoint: check its folder and make it ready."""

import json
import time
from dataclasses import dataclass
from pathlib import Path

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.base.sources import source_digest
from deltaswarm_orchestrator.recording.names import PART, RECORDING, WIRE
from deltaswarm_orchestrator.results.folder import FolderError
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checkpoint

BEFORE = ".before"
"""Suffix of an earlier recording that the new recording is copied from."""

LEFTOVERS_S = 10.0

OPERATOR_STATE, OPERATOR_ROWS = "operator-state.json", "operator.csv"
"""The operator's files during a run."""

OF_AN_END = ("series.csv", "events.csv", "summary.json", "world.json", "operator.json")
"""Files that a run writes when it ends, complete or not."""


@dataclass(frozen=True)
class Resumed:
    """The point at which a run is resumed."""

    step: int
    """The last step before it."""
    agents: tuple[int, ...]
    """The agents that were in the run at that step."""
    restarts: dict[int, int]
    """How often each agent had been restarted."""


def newest(folder: Path) -> Resumed:
    """Return the newest checkpoint in a run's folder.

    Raises:
        FolderError: there is no checkpoint, it cannot be read, or a file of it is missing, cut off or changed.
    """
    file = folder / checkpoint.FOLDER / checkpoint.NEWEST
    if not file.exists():
        reason = f"{folder} has no checkpoint to go on from; `deltaswarm run --checkpoint STEPS` writes them"
        raise FolderError(reason)
    try:
        told = json.loads(file.read_text())
        resumed = Resumed(int(told["step"]), tuple(map(int, told["agents"])), dict(told["restarts"]))
        saved, digests = file.with_name(str(resumed.step)), dict(told["sha256"])
        for file in checkpoint.files(saved, resumed.agents):
            if checkpoint.digest(file) != digests[file.name]:
                raise ValueError("it has been changed or damaged")
        file = saved / checkpoint.OPERATOR_FILE
        least_bytes = {folder / name: int(size) for name, size in told["tables"].items()}
        least_bytes |= {folder / OPERATOR_ROWS: int(json.loads(file.read_text())["table_bytes"])}
        for file, least in least_bytes.items():
            if (size := file.stat().st_size) < least:
                raise ValueError(f"it must have at least {least} bytes (got {size})")
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        reason = str(error) if isinstance(error, OSError | ValueError) else repr(error)
        raise FolderError(f"{file}, which is part of the checkpoint, cannot be used: {reason}") from None
    return resumed


def check_code(folder: Path, scenario: Scenario) -> None:
    """Refuse a run that another version of the code began, whose checkpoint this one cannot use.

    Raises:
        FolderError: the code differs, or the manifest cannot be read.
    """
    file = folder / "manifest.json"
    try:
        manifest = json.loads(file.read_text())
        begun_by = manifest.get("code"), manifest.get("controller", {}).get("source")
    except (OSError, ValueError, AttributeError) as error:
        raise FolderError(f"{file} cannot be read: {error}") from None
    if begun_by != (provenance.code_digest(), source_digest(scenario.control.mode)):
        raise FolderError(f"{folder} was started by another version of deltaswarm; resume it with that version")


def wait_for_leftovers(folder: Path) -> None:
    """Wait for processes of the interrupted run, which end by themselves once their orchestrator is gone.

    Raises:
        FolderError: a process has not ended after LEFTOVERS_S.
    """
    deadline = time.monotonic() + LEFTOVERS_S
    while left := [path.parts[2] for path in Path("/proc").glob("[0-9]*/fd/2") if _is_log_of(folder, path)]:
        if time.monotonic() >= deadline:
            raise FolderError(f"{folder} is still being written by processes of the earlier run: {', '.join(left)}")
        time.sleep(0.1)


def _is_log_of(folder: Path, standard_error: Path) -> bool:
    try:
        return standard_error.readlink().parent == folder / "logs"
    except OSError:  # the process has ended, or is another user's
        return False


def make_ready(folder: Path, resumed: Resumed) -> dict[str, Path]:
    """Remove what was written after the checkpoint; return the recordings that the new ones start from, by name."""
    for name in OF_AN_END:
        (folder / name).unlink(missing_ok=True)
    operator = folder / checkpoint.FOLDER / str(resumed.step) / checkpoint.OPERATOR_FILE
    checkpoint.write(folder / OPERATOR_STATE, operator.read_bytes())
    before = {}
    for name in (RECORDING, WIRE):
        kept = folder / f"{name}{BEFORE}"
        for file in (folder / name, folder / f"{name}{PART}"):
            if file.exists() and not kept.exists():  # else an earlier attempt to resume was interrupted while copying
                file.rename(kept)
            file.unlink(missing_ok=True)
        if kept.exists():
            before[name] = kept
    return before
