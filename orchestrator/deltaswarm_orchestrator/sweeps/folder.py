"""A sweep's folder: a file for each finished run, so that whatever ends a sweep, it goes on where it was."""

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import orjson

from deltaswarm_orchestrator.sweeps.plan import Job
from deltaswarm_orchestrator.sweeps.work import IN_PROCESS, Result


class SweepFolderError(Exception):
    """The folder cannot be used: another sweep's, in use, or no folder."""


class SweepFolder:
    """`runs/` with a file per finished run, `manifest.json`, tables; nothing is ever deleted but scratch files."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.runs = path / "runs"
        self.scratch = path / "scratch"

    @contextmanager
    def held(self, name: str) -> Iterator[None]:
        """Make the folder, or take it up again; nobody else writes to it meanwhile.

        Raises:
            SweepFolderError: it is in use, or holds something else.
        """
        try:
            found = self.manifest()
            if found is None and self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
                raise SweepFolderError(f"{self.path} exists and holds no sweep; choose another folder by --out")
            self.runs.mkdir(parents=True, exist_ok=True)
            lock = os.open(self.path / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise SweepFolderError(f"{self.path} cannot be used: {error.strerror}") from None
        try:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise SweepFolderError(f"{self.path} is in use by another sweep") from None
            if found is not None and found.get("name") != name:
                raise SweepFolderError(f"{self.path} holds the sweep {found.get('name')!r}, not {name!r}")
            shutil.rmtree(self.scratch, ignore_errors=True)
            self.scratch.mkdir()
            yield
            shutil.rmtree(self.scratch, ignore_errors=True)
        finally:
            os.close(lock)

    def file(self, job: Job, means: str) -> Path:
        """Where a finished run is kept."""
        return self.runs / f"{job.key}.{means}.json"

    def has(self, job: Job, means: str = IN_PROCESS) -> bool:
        """Whether a run is finished."""
        return self.file(job, means).exists()

    def save(self, job: Job, means: str, result: Result) -> None:
        """Keep a finished run; on the disk when this returns."""
        write_whole(self.file(job, means), orjson.dumps(result))

    def result(self, job: Job, means: str = IN_PROCESS) -> Result | None:
        """A finished run; None if it is not."""
        with contextlib.suppress(FileNotFoundError):
            return dict(orjson.loads(self.file(job, means).read_bytes()))
        return None

    def manifest(self) -> dict[str, Any] | None:
        """What the folder says of itself; None before the first sweep in it.

        Raises:
            SweepFolderError: it cannot be read.
        """
        try:
            found = orjson.loads((self.path / "manifest.json").read_bytes())
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise SweepFolderError(f"{self.path / 'manifest.json'} cannot be read: {error}") from None
        if not isinstance(found, dict):
            raise SweepFolderError(f"{self.path / 'manifest.json'} is no sweep's manifest")
        return found

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        """Write `manifest.json` whole."""
        write_whole(self.path / "manifest.json", orjson.dumps(manifest, option=orjson.OPT_INDENT_2))

    def finished(self, jobs: Sequence[Job], means: str) -> list[Job]:
        """Those of the jobs that are finished."""
        return [job for job in jobs if self.has(job, means)]


def write_whole(file: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    part = file.with_name(f"{file.name}.part")
    with part.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(file)
