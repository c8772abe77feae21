"""Reuse runs that several experiments have in common, above all those without a limit."""

from collections.abc import Sequence
from pathlib import Path

from deltaswarm_orchestrator.base import provenance
from deltaswarm_orchestrator.sweeps.folder import SweepFolder
from deltaswarm_orchestrator.sweeps.plan import Sweep


def take_over(sweep: Sweep, path: Path, others: Sequence[Path]) -> int:
    """Copy the runs that a sweep lacks from other sweeps' folders; return their number.

    A run is the same if its key and the digest of its code are the same.

    Raises:
        SweepFolderError: the folder is in use, holds something else, or cannot be written.
    """
    folder, code = SweepFolder(path), provenance.code_digest()
    taken = 0
    with folder.held(sweep.name):
        for job in sweep.jobs():
            if folder.has(job):
                continue
            found = (SweepFolder(other).result(job) for other in others if other != path)
            result = next((one for one in found if one is not None and one.get("code") == code), None)
            if result is not None:
                folder.save(job, "in-process", result)
                taken += 1
    return taken
