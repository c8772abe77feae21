"""Freeze a study's protocol before its first run, and amend it with a reason."""

from pathlib import Path

from deltaswarm_orchestrator.base import frozen, provenance
from deltaswarm_orchestrator.base.advice import command_line
from deltaswarm_orchestrator.base.frozen import HASH
from deltaswarm_studies.protocol import FILE, Protocol, ProtocolError, protocol_of
from deltaswarm_studies.settings import EXPLORATORY
from deltaswarm_studies.study import Study


def freeze(study: Study, folder: Path, file: Path | None) -> Path:
    """Write `protocol.json` before the study's first run; `file` is the study's, None if it is built in.

    Raises:
        ProtocolError: it is exploratory, frozen already, or some of its runs are there.
    """
    known = protocol_of(study, folder)
    if known.kind == EXPLORATORY:
        raise ProtocolError(f"{study.name}: study.kind must be 'confirmatory' to be frozen (got {EXPLORATORY!r})")
    if known.entries:
        amend = command_line("study", file or study.name, "--out", folder, "--amend", "REASON")
        raise ProtocolError(
            f"{folder / FILE} must not be there yet: it was frozen on {known.entries[0]['date']}; to change it: {amend}"
        )
    if runs := _runs(study, folder):
        raise ProtocolError(f"{study.name} must be frozen before its first run ({len(runs)} are there, as {runs[0]})")
    return _add(known, folder, file, "")


def amend(study: Study, folder: Path, file: Path | None, reason: str) -> Path:
    """Add an entry with what changed and its reason to `protocol.json`; all earlier entries stay.

    Raises:
        ProtocolError: it is not frozen, was edited by hand, nothing changed, or no reason is given.
    """
    known = protocol_of(study, folder)
    if not reason.strip():
        raise ProtocolError("--amend must be a reason (got an empty one)")
    if not known.entries:
        raise ProtocolError(f"{folder / FILE} must be there before it is amended; to freeze it: --freeze")
    if edited := [line for line in known.problems if line.startswith(FILE)]:
        raise ProtocolError(f"{folder}: {edited[0]} Restore it first.")
    if not known.unamended:
        raise ProtocolError(f"{study.name}: nothing differs from the protocol of {known.entries[-1]['date']}")
    return _add(known, folder, file, " ".join(reason.split()))


def _runs(study: Study, folder: Path) -> list[Path]:
    """List the study's runs in its own folder, and those in the folders of other studies beside it."""
    keys = {job.key for job in study.sweep.jobs()}
    beside = [run for run in folder.parent.glob("*/sweep/runs/*.json") if run.name.partition(".")[0] in keys]
    own = [*folder.glob("sweep/runs/*.json"), *folder.glob("runs.csv")]
    return list(dict.fromkeys([*own, *beside]))


def _add(known: Protocol, folder: Path, file: Path | None, reason: str) -> Path:
    code = provenance.commit()
    commit, uncommitted = {"deltaswarm": code}, []
    if code is None or code.endswith("-dirty"):
        state = "have no known commit" if code is None else "differ from it"
        uncommitted.append(f"the sources of deltaswarm {state}")
    if file is not None:
        commit[file.name], is_committed = provenance.commit_of(file)
        uncommitted += [] if is_committed else [f"{file.name} is not committed as it is"]
    entry = {
        "date": provenance.now(),
        "commit": commit,
        "uncommitted": uncommitted,
        "reason": reason,
        "protocol": known.now,
    }
    before = known.entries[-1][HASH] if known.entries else ""
    entry[HASH] = frozen.hash_of(entry, known.study, before)
    return frozen.write(folder / FILE, {"study": known.study, "entries": [*known.entries, entry]})
