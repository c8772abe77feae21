"""Describe a run from its folder, whether the run is complete or was interrupted."""

import json
import tomllib
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeVar

from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.exits import CommandError, aligned, shown
from deltaswarm_orchestrator.recording import PART, RECORDING, WIRE
from deltaswarm_orchestrator.results import run_tables
from deltaswarm_orchestrator.results.folder import FolderError, results_in
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError, is_held
from deltaswarm_orchestrator.results.outcome import Outcome
from deltaswarm_orchestrator.results.resume import BRANCH, newest
from deltaswarm_orchestrator.results.summary import main_rows, summarise
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire import checked
from deltaswarm_wire.plugins import as_recorded

T = TypeVar("T")


class NotARunError(CommandError):
    """The folder is no run folder, or cannot be read."""


def describe(folder: Path) -> dict[str, Any]:
    """Return a run's state, manifest, summary (computed if the run did not write one) and files.

    Raises:
        NotARunError: the manifest or scenario is missing, or a file cannot be read or is not as it was written.
    """
    manifest = seal.read_sealed(folder / seal.MANIFEST)
    written = folder / "summary.json"
    scenario, outcome = read_run(folder)
    with provenance.reading(manifest):
        summary = _read(written, json.loads) if written.exists() else summarise(outcome, scenario)
    if not manifest:
        raise NotARunError(f"{folder / seal.MANIFEST} is missing")
    files = {path.name: path.stat().st_size for path in sorted(folder.iterdir()) if path.is_file()}
    unsealed = seal.not_sealed(manifest, results_in(folder))
    run = {"folder": str(folder), "manifest": manifest, "summary": summary, "files": files, "not_sealed": unsealed}
    try:
        if manifest["exit_reason"] == run_tables.RUNNING and summary["complete"]:
            reason = "all steps are done, and the run was not concluded"
            summary |= {"complete": False, "valid": False, "invalid_because": [reason, *summary["invalid_because"]]}
        run["state"] = state = _state(folder, manifest, summary)
        run["checkpoint_step"] = None if state == run_tables.RUNNING else _checkpoint_step(folder)
        text(run)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise NotARunError(f"{folder}: manifest.json or summary.json has been changed or damaged: {error!r}") from None
    return run


def _checkpoint_step(folder: Path) -> int | None:
    """Return the step after which an interrupted run can be resumed; None if it cannot."""
    try:
        return newest(folder).step
    except FolderError:
        return None


def _state(folder: Path, manifest: dict[str, Any], summary: dict[str, Any]) -> str:
    """Return whether the run is complete, is running, or ended too early, and why."""
    if summary["complete"]:
        return "complete"
    if manifest["exit_reason"] != run_tables.RUNNING:
        return f"incomplete ({manifest['exit_reason']})"
    died = "incomplete (killed, its machine stopped, or its disk was full)"
    return {True: run_tables.RUNNING, False: died, None: f"{run_tables.RUNNING}, or {died}"}[is_held(folder)]


def read_run(folder: Path) -> tuple[Scenario, Outcome]:
    """Read the scenario and the outcome of a run, without the code of its plug-ins."""
    if not (folder / "scenario.toml").is_file():
        is_sweep = (folder / "sweep.toml").is_file()
        reason = f"a sweep's folder: see {command_line('report', folder)}" if is_sweep else "it has no scenario.toml"
        raise NotARunError(f"{folder} must be a run folder, written by `deltaswarm run` ({reason})")
    if not is_held(folder):  # a run that is just ending has sealed what it is about to write
        seal.checked(folder / seal.MANIFEST)
    with as_recorded():
        scenario = _read(folder / "scenario.toml", lambda toml: checked.load(Scenario, tomllib.loads(toml)))
    try:
        return scenario, run_tables.read_outcome(folder)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise NotARunError(f"the tables in {folder} cannot be read: {error!r}") from None


def _read(file: Path, parse: Callable[[str], T]) -> T:
    try:
        return parse(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise NotARunError(f"{file} cannot be read: {reason}") from None


def text(run: dict[str, Any]) -> str:
    manifest, summary = run["manifest"], run["summary"]
    rows = [
        ("started", manifest["started"]),
        ("engine", manifest["engine"]),
        *_origin(manifest.get(BRANCH)),
        *((f"{title} [{unit}]" if unit else title, shown(value)) for title, value, unit in main_rows(summary)),
        ("agents lost", ", ".join(map(str, summary["agents_lost"])) or "none"),
        ("versions", ", ".join(f"{name} {number}" for name, number in manifest["versions"].items() if number)),
        *(("ended because", line) for why in manifest.get("why", []) for line in why.splitlines()),
    ]
    if run["checkpoint_step"] is not None:
        rows.append(
            (f"checkpoint at step {run['checkpoint_step']}", command_line("run", "--resume", Path(run["folder"])))
        )
    for fault in summary.get("faults", []):
        agents = ", ".join(map(str, fault["agents"])) or "none"
        rows.append((f"fault at {fault['at_s']:g} s", f"{fault['kind']}, agents: {agents}"))
    rows += [("not valid", reason) for reason in summary["invalid_because"]]
    rows += [("not sealed", ", ".join(run["not_sealed"]))] if run["not_sealed"] else []
    rows += [(name, f"{size:,} bytes") for name, size in run["files"].items()]
    return f"{manifest['name']}, {summary['mode']}, seed {manifest['seed']}: {run['state']}\n{aligned(rows)}"


def _origin(branch: dict[str, Any] | None) -> Iterator[tuple[str, str]]:
    """Yield the rows about the parent of a branch, and about what is different."""
    if branch:
        parent, at = branch["parent"], f"{branch['at_s']:g} s (step {branch['at_step']})"
        yield "branch of", f"{parent['folder']}, digest {parent['digest']}"
        yield f"from {at} on", f"{branch['says']}; later orders: {branch['later_orders']}"


def how_it_ended(folder: Path) -> dict[str, Any]:
    """Return the state of a run, what failed in it, in order, and why it is not valid."""
    run = describe(folder)
    return {
        "folder": run["folder"],
        "state": run["state"],
        "why": run["manifest"].get("why", []),
        "valid": run["summary"]["valid"],
        "invalid_because": run["summary"]["invalid_because"],
    }


def ending_text(ending: dict[str, Any]) -> str:
    happened = [f"{number}. {line}" for number, line in enumerate(ending["why"], 1)]
    if not happened and ending["state"] == "complete" and ending["valid"]:
        happened = ["nothing failed"]
    invalid = [f"not valid: {reason}" for reason in ending["invalid_because"]]
    return "\n".join([f"{ending['folder']}: {ending['state']}", *happened, *invalid])


def finish_recordings(folder: Path) -> list[Path]:
    """Give the recordings of a killed run their end, in place; return those that lacked it.

    Left as they are: a file that is damaged before its end, since what comes after the damage would be lost, and all
    files of a folder that a run holds or that cannot be written.
    """
    if not any(folder.glob(f"*{PART}")):
        return []
    # These import protobuf, which is slow.
    from deltaswarm_orchestrator.recording.finishing import is_cut_off, write_complete_copy
    from deltaswarm_orchestrator.recording.reader import RecordingError

    try:
        cut_off = [part for name in (RECORDING, WIRE) if is_cut_off(part := folder / (name + PART))]
        with ExitStack() as stack:
            if cut_off:
                stack.callback(FolderLock(folder).release)
            for part in cut_off:
                complete = part.with_name(f"{part.name}.complete")
                stack.callback(complete.unlink, missing_ok=True)
                write_complete_copy(part, complete)
                complete.replace(part)
    except (HeldError, OSError, RecordingError):  # what is wrong is said where the run is read
        return []
    return cut_off
