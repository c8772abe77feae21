"""A sweep's folder: a file for each finished run, so that a sweep can be resumed."""

import hashlib
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import orjson

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_orchestrator.base.paths import check_files
from deltaswarm_orchestrator.results.folder_lock import LOCK, FolderLock, HeldError
from deltaswarm_orchestrator.sweeps.job import IN_PROCESS, Result
from deltaswarm_orchestrator.sweeps.plan import Job
from deltaswarm_wire.files import write_whole

CHECKSUM, KEY = "checksum", "key"
"""Entries of a result's file: the checksum of the rest, and the key of its job, so that no other run passes for it."""


class SweepFolderError(CommandError):
    """The folder cannot be used: it holds another sweep, is in use, or is no folder."""


class SweepFolder:
    """`runs/` with a file per finished run, `manifest.json` and tables. Only scratch files are ever deleted."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.runs = path / "runs"
        self.scratch = path / "scratch"

    @contextmanager
    def held(self, name: str) -> Iterator[None]:
        """Create or reopen the folder, and lock it for the length of the block."""
        with ExitStack() as stack:
            try:
                self.check(name)
                self.path.mkdir(parents=True, exist_ok=True)
                stack.callback(FolderLock(self.path).release)
                self.check(name)  # another sweep may have begun meanwhile
                self.runs.mkdir(exist_ok=True)
                shutil.rmtree(self.scratch, ignore_errors=True)
                self.scratch.mkdir(exist_ok=True)  # an orphaned run may still be writing there
                stack.callback(shutil.rmtree, self.scratch, ignore_errors=True)
            except HeldError as error:
                raise SweepFolderError(f"{self.path} is in use by another sweep{error}") from None
            except OSError as error:
                raise SweepFolderError(f"{self.path} cannot be used: {error.strerror}") from None
            yield

    def check(self, name: str) -> None:
        """Check that the folder can hold the sweep of this name, or does not exist."""
        check_files(self.path, 1)
        try:
            if self.path.exists() and not self._is_ours():
                raise SweepFolderError(f"{self.path} exists and holds no sweep; choose another folder by --out")
        except OSError as error:
            raise SweepFolderError(f"{self.path} cannot be used: {error.strerror}") from None
        manifest = self.manifest()
        if manifest is not None and manifest.get("name") != name:
            raise SweepFolderError(f"{self.path} holds the sweep {manifest.get('name')!r}, not {name!r}")

    def _is_ours(self) -> bool:
        """Return whether the folder is a sweep's or empty.

        A sweep writes its lock first, and may be killed before it writes more. A single run's folder may have a lock
        and a manifest too, but it has a scenario, and its manifest has no `swept`.
        """
        if not self.path.is_dir() or (self.path / "scenario.toml").exists():
            return False
        return (self.path / LOCK).exists() or "swept" in (self.manifest() or ()) or not any(self.path.iterdir())

    def file(self, job: Job, means: str) -> Path:
        return self.runs / f"{job.key}.{means}.json"

    def has(self, job: Job, means: str = IN_PROCESS) -> bool:
        return self.result(job, means) is not None

    def is_damaged(self, job: Job, means: str = IN_PROCESS) -> bool:
        return self.file(job, means).exists() and not self.has(job, means)

    def save(self, job: Job, means: str, result: Result) -> None:
        """Save a finished run; it is on disk when this returns. Raises OSError."""
        kept = {KEY: job.key, **result}
        write_whole(self.file(job, means), orjson.dumps({CHECKSUM: _checksum(kept), **kept}))

    def result(self, job: Job, means: str = IN_PROCESS) -> Result | None:
        """Read a finished run; return None if it is not finished, or its file is damaged or is that of another run."""
        file = self.file(job, means)
        try:
            result = orjson.loads(file.read_bytes()) if file.is_file() else None  # a named pipe would never end
        except (OSError, ValueError):
            return None
        if not isinstance(result, dict) or result.pop(CHECKSUM, None) != _checksum(result):
            return None
        is_its_own = result.pop(KEY, job.key) == job.key and result.get("seed") == job.scenario.seed
        return result if is_its_own and result.get("means") == means else None

    def manifest(self) -> dict[str, Any] | None:
        """Read the manifest; return None before the first sweep in the folder."""
        return seal.read_sealed(self.path / seal.MANIFEST) or None

    def write_manifest(self, manifest: dict[str, Any], files: Mapping[str, Sequence[Any]]) -> None:
        seal.write_sealed(self.path / seal.MANIFEST, manifest, files)


def _checksum(result: Result) -> str:
    return hashlib.blake2b(orjson.dumps(result), digest_size=16).hexdigest()
