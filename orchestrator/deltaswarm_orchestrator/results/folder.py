"""The folder of a run in progress: its lock, what it may replace, and its final name."""

import errno
import os
import secrets
import shutil
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from deltaswarm_orchestrator.base import disk, seal
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.base.paths import part_of
from deltaswarm_orchestrator.recording import LAYOUT, PART, RECORDING, WIRE
from deltaswarm_orchestrator.results.folder_lock import LOCK, LOCK_FILES, FolderLock, HeldError, is_held
from deltaswarm_orchestrator.results.run_tables import write_json
from deltaswarm_orchestrator.scenarios.load import to_toml
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.files import sync_folder, write_whole

SCENARIO, SUMMARY = "scenario.toml", "summary.json"

RUN_FILES = {seal.MANIFEST, SCENARIO}
"""Files that every run folder has; a sweep's folder does not have both."""

BEGINNING = {*LOCK_FILES, "scenario.toml.part", "scenario.toml", disk.RESERVE, "manifest.json.part"}
"""The only files in the folder of a run that was killed before it had all of RUN_FILES."""

NOT_SEALED = {*LOCK_FILES, disk.RESERVE, seal.MANIFEST, RECORDING, WIRE, LAYOUT}
"""Files that a run's seal leaves out: those of its writing, recordings (own checksums), what no command reads."""

DELETE_TRIES = 10
IN_PROGRESS, USE_ANOTHER = "is being written by a run in progress", "end that run, or use another folder"


class FolderError(CommandError):
    """The run folder cannot be made, is in use by another run, or exists and `--force` was not given."""


class FolderTakenError(FolderError):
    """A complete run cannot get its final name and keeps the name it was written under."""

    code = FAILED


class RunFolder:
    """A run's folder: written as `<name>.part`, renamed to `<name>` when complete, and locked until then.

    The folder is locked before it gets the name `.part` and until it gets its final name, so every `.part` that is
    being written is locked. An old `.part` is locked, too, and moved away before it is deleted. Leave the context, or
    call `release`, to release the lock.

    Raises:
        FolderError: the folder cannot be used; the text says why, and what to do.
    """

    def __init__(self, target: Path, *, force: bool) -> None:
        check_target(target, force)
        self.target = target
        self.path = part_of(target)
        self._force = force
        new = _beside(self.path)
        try:
            new.mkdir(parents=True)
            self._lock = FolderLock(new)
        except OSError as error:
            shutil.rmtree(new, ignore_errors=True)
            raise FolderError(f"{self.path} cannot be made: {error.strerror}", _code_of(error)) from None
        try:
            self._delete_interrupted()
            new.rename(self.path)  # fails if another run's folder is there, since that is never empty
        except OSError as error:
            is_late = error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT)
            reason = "another run has just made it" if is_late else error.strerror
            raise FolderError(f"{self.path} cannot be made: {reason}", _code_of(error)) from None
        finally:
            if not self._lock.is_at(self.path):
                self._lock.release()
                shutil.rmtree(new, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None and self.is_there() and not (self.path / seal.MANIFEST).exists():
            _delete(self.path)  # of a run that has not begun: it would be in the way of the next one
        self.release()

    def release(self) -> None:
        self._lock.release()

    def is_there(self) -> bool:
        """Whether the folder is still where it was made."""
        return self._lock.is_at(self.path)

    def prepare(self, scenario: Scenario, manifest: dict[str, Any]) -> None:
        """Write scenario and manifest, and reserve disk space for the results at the end.

        The scenario is synced to disk: a run that is resumed after a power loss needs it.
        """
        write_whole(self.path / SCENARIO, to_toml(scenario).encode())
        with suppress(PermissionError):  # the folder may be writable but not readable
            sync_folder(self.path.parent)
        self.prepare_to_resume(manifest)

    def prepare_to_resume(self, manifest: dict[str, Any]) -> None:
        """Reserve disk space and write the manifest; the scenario is already there."""
        disk.keep_reserve(self.path)
        seal.write_sealed(self.path / seal.MANIFEST, manifest, seal.digests(self.path, [SCENARIO]))

    def conclude(self, manifest: dict[str, Any], summary: dict[str, Any]) -> None:
        """Write the summary, and the manifest, which seals all results.

        If the disk has room for one of them, it is for the manifest, without which nobody knows how the run ended.
        """
        file, failed = self.path / SUMMARY, None
        try:
            write_json(file, summary)
            self._seal_results(manifest)
        except OSError as error:
            failed = error
            for left in (file, file.with_name(f"{SUMMARY}{PART}")):
                left.unlink(missing_ok=True)
            self._seal_results(manifest)
        if failed:
            raise failed

    def _seal_results(self, manifest: dict[str, Any]) -> None:
        seal.write_sealed(self.path / seal.MANIFEST, manifest, seal.digests(self.path, results_in(self.path)))

    def finish(self) -> Path:
        """Give the folder its final name, release it, and return its path."""
        kept = f"the whole run is in {self.path}; rename that folder"
        replaced = None
        if os.path.lexists(self.target):
            if not (self._force and _is_replaceable(self.target)):
                reason = "it is not a run folder" if self._force else "--force was not given"
                raise FolderTakenError(f"{self.target} appeared during the run and is not replaced ({reason}): {kept}")
            replaced = _beside(self.path)
        try:
            if replaced is not None:
                self.target.rename(replaced)
            self.path.rename(self.target)
        except OSError as error:
            raise FolderTakenError(f"{self.target} cannot be made ({error.strerror}): {kept}") from None
        if replaced is not None:
            _delete(replaced)
        self.release()
        with suppress(OSError):
            (self.target / LOCK).unlink()
        return self.target

    def _delete_interrupted(self) -> None:
        """Delete the folder of an interrupted run, if there is one."""
        _check_part(self.path, self._force)
        if not os.path.lexists(self.path):
            return
        try:
            lock = FolderLock(self.path)
        except HeldError as error:
            raise FolderError(f"{self.path} {IN_PROGRESS}{error}: {USE_ANOTHER}") from None
        try:
            if not lock.is_at(self.path):
                raise FileExistsError(errno.EEXIST, "another run took it first")
            away = _beside(self.path)
            self.path.rename(away)
            _delete(away)
        finally:
            lock.release()


class ResumedFolder(RunFolder):
    """The folder of an interrupted run, `X.part` or `X`, taken to resume the run in `X.part`.

    With `force`, the run in `X.part` replaces the complete one in `X`.

    Raises:
        FolderError: it is no run folder, another process writes to it, or both `X` and `X.part` exist.
    """

    def __init__(self, folder: Path, *, force: bool = False) -> None:
        folder = folder.resolve()
        self.target = folder.with_name(folder.name.removesuffix(".part"))
        self.path = self.target.with_name(f"{self.target.name}.part")
        self._force = force
        if not (folder.is_dir() and {path.name for path in folder.iterdir()} >= RUN_FILES):
            raise FolderError(f"{folder} is not the folder of a run that was started")
        for other in {self.target, self.path} - {folder}:
            if os.path.lexists(other) and not (force and other == self.target and _is_replaceable(other)):
                raise FolderError(
                    f"{other} exists beside {folder}; rename or remove the one that should not be resumed"
                )
        try:
            self._lock = FolderLock(folder)
        except HeldError as error:
            raise FolderError(f"{folder} is being written by a run in progress{error}") from None
        except OSError as error:
            raise FolderError(f"{folder} cannot be written: {error.strerror}") from None
        if not self._lock.is_at(folder):
            self._lock.release()
            raise FolderError(f"{folder} was taken by another run")
        folder.rename(self.path)


def _code_of(error: OSError) -> int | None:
    """Return the exit code if the disk is at fault; None if the user is."""
    return FAILED if disk.is_refused(error) else None


def _beside(path: Path) -> Path:
    return path.with_name(f"{path.name}-{secrets.token_hex(4)}")


def _delete(folder: Path) -> None:
    """Delete a folder that nobody uses; retry, since a process that came too late for the lock may add a lock file."""
    for _ in range(DELETE_TRIES):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return


def results_in(folder: Path) -> set[str]:
    """Return the names of the files in a run's folder that the seal of a run that has ended vouches for."""
    names = {path.name for path in folder.iterdir() if path.is_file()}
    return {name for name in names - NOT_SEALED if not name.endswith(PART)}


def check_target(target: Path, force: bool) -> None:
    """Refuse a target that a run could not be written to, or that the finished run could not be renamed to.

    It is the rule of all commands that write a run's folder: with `force` another run's gives way, whole or not.
    """
    try:
        is_link, exists = target.is_symlink(), target.exists()
    except OSError as error:
        raise FolderError(f"{target} cannot be used: {error.strerror}") from None
    if is_link:
        raise FolderError(f"{target} is a symbolic link (to {target.readlink()}); name the folder itself")
    if not exists:
        if target.name in ("", ".."):
            raise FolderError(f"{target} must end in the name of the new folder")
        _check_part(part_of(target), force)
        return
    if not force:
        raise FolderError(f"{target} exists; --force replaces it")
    if not _is_replaceable(target):
        raise FolderError(f"{target} exists and is not a run folder; --force does not replace it")
    _check_part(part_of(target), force)


def _check_part(part: Path, force: bool) -> None:
    """Refuse the folder in which a run is until it is complete, if there is one that must stay. Raises FolderError."""
    if not os.path.lexists(part):
        return
    if not _is_replaceable(part, BEGINNING):
        raise FolderError(f"{part} exists and is not a run folder; a run needs this name until it is complete")
    if is_held(part):
        raise FolderError(f"{part} {IN_PROGRESS}: {USE_ANOTHER}")
    if not force:
        raise FolderError(f"{part} exists: an interrupted run; --force replaces it")


def _is_replaceable(folder: Path, without_a_run: Collection[str] = LOCK_FILES) -> bool:
    """Whether a folder is a run's or has only files of `without_a_run`, so that `--out .. --force` deletes no other."""
    if folder.name in ("", "..") or folder.is_symlink():
        return False
    try:
        names = {path.name for path in folder.iterdir()}
    except OSError:
        return False
    return names >= RUN_FILES or names <= set(without_a_run)
