"""Resume an interrupted run from its newest checkpoint: check its folder and make it ready."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base import inputs, provenance, seal
from deltaswarm_orchestrator.base.provenance import sources
from deltaswarm_orchestrator.recording import COMMANDS, PART, RECORDING, WIRE
from deltaswarm_orchestrator.results.folder import FolderError
from deltaswarm_scenario.scenario import Scenario, scenario_digest
from deltaswarm_wire import checkpoint

BEFORE = ".before"
"""Suffix of an earlier recording that the new recording is copied from."""

LEFTOVERS_S = 10.0

BRANCH, AFTER_STEP = "branch", "after_step"
"""The entry of a branch's manifest about its parent, and the step of the checkpoint from which the branch begins."""

OPERATOR_STATE = "operator-state.json"
"""What an operator resumes from."""

OF_AN_END = ("series.csv", "events.csv", "summary.json", "world.json", "operator.json", COMMANDS, "commands.csv")
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
    scenario: str
    """`scenario_digest` of the run."""


def newest(folder: Path) -> Resumed:
    """Return the newest checkpoint in a run's folder.

    Raises:
        FolderError: there is no checkpoint, it cannot be read, or a file of it is missing, cut off or changed.
    """
    file = folder / checkpoint.FOLDER / checkpoint.NEWEST
    if not file.exists():
        raise FolderError(f"{folder} has no checkpoint to go on from; `deltaswarm run --checkpoint STEPS` writes them")
    try:
        content = checkpoint.unsealed(file.read_bytes())
        resumed = Resumed(
            int(content["step"]), tuple(map(int, content["agents"])), dict(content["restarts"]), content["scenario"]
        )
        saved, digests = file.with_name(str(resumed.step)), dict(content["sha256"])
        for file in checkpoint.files(saved, resumed.agents):
            if checkpoint.digest(file.read_bytes()) != digests[file.name]:
                raise ValueError("it has been changed or damaged")
        file = saved / checkpoint.OPERATOR_FILE
        tables = content["tables"] | json.loads(file.read_text(encoding="utf-8"))["tables"]
        for name in tables:
            file = folder / name
            checkpoint.check_tables(folder, {name: tables[name]})
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        reason = str(error) if isinstance(error, OSError | ValueError) else repr(error)
        raise FolderError(f"{file}, which is part of the checkpoint, cannot be used: {reason}") from None
    return resumed


def check_inputs(folder: Path, scenario: Scenario) -> None:
    """Refuse a run that began with another scenario or other code, whose checkpoint these cannot go on from.

    Raises:
        FolderError, SealError: scenario or code differ, or a file has been changed or cannot be read.
    """
    manifest = seal.checked(folder / seal.MANIFEST)
    try:
        begun_by = manifest["code"], _sources_in(manifest)
    except (AttributeError, TypeError, KeyError) as error:
        raise FolderError(f"{folder / seal.MANIFEST} is not as a run writes it: {error!r}") from None
    if begun_by != (provenance.code_digest(), [source.digest for source in sources(scenario)]):
        other = inputs.differences(manifest.get("inputs", {}), inputs.identify(scenario)) or "extensions or deltaswarm"
        raise FolderError(f"{folder} was started with other versions of: {other}; resume it with those")
    if newest(folder).scenario != scenario_digest(scenario):
        reason = "or a file that it names has been changed since the run began: undo that, or start a new run"
        raise FolderError(f"{folder / 'scenario.toml'} {reason}")


def _sources_in(manifest: dict[str, Any]) -> list[str]:
    """Return the digest of each extension that a run rested on, as `sources` orders them."""
    controller = manifest.get("controller", {}).get("source")
    return [*([controller] if controller else []), *(source["digest"] for source in manifest.get("extensions", ()))]


def wait_for_leftovers(folder: Path) -> None:
    """Wait for processes of the interrupted run, which end by themselves once their orchestrator is gone.

    Raises:
        FolderError: a process has not ended after LEFTOVERS_S.
    """
    deadline = time.monotonic() + LEFTOVERS_S
    while left_over := [path.parts[2] for path in Path("/proc").glob("[0-9]*/fd/2") if _is_log_of(folder, path)]:
        if time.monotonic() >= deadline:
            raise FolderError(
                f"{folder} is still being written by processes of the earlier run: {', '.join(left_over)}"
            )
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
