"""Give the recordings of a killed run the end that they lack."""

from contextlib import ExitStack
from pathlib import Path

from deltaswarm_orchestrator.recording.names import PART, RECORDING, WIRE
from deltaswarm_orchestrator.recording.reader import Damage, RecordingError, records
from deltaswarm_orchestrator.recording.whole import write_whole_copy
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError


def finish_recordings(folder: Path) -> list[Path]:
    """Give the recordings of a killed run their end, in place; return those that lacked it.

    Left as they are: a file that is damaged before its end, since what comes after the damage would be lost, and all
    files of a folder that a run holds or that cannot be written.
    """
    try:
        cut_off = [part for name in (RECORDING, WIRE) if _is_cut_off(part := folder / (name + PART))]
        with ExitStack() as stack:
            if cut_off:
                stack.callback(FolderLock(folder).release)
            for part in cut_off:
                _finish(part)
    except (HeldError, OSError):
        return []
    return cut_off


def _is_cut_off(part: Path) -> bool:
    try:
        return part.exists() and Damage(is_at_the_end=True) in records(part)
    except RecordingError:
        return False


def _finish(part: Path) -> None:
    whole = part.with_name(f"{part.name}.whole")
    try:
        write_whole_copy(part, whole)
        whole.replace(part)
    finally:
        whole.unlink(missing_ok=True)
