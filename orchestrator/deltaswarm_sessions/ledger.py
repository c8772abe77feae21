"""The record of a folder of sessions, `roster.json`: one lock and one seal for whatever the folder keeps.

It says who began, who withdrew, where tables were written, and what a command has begun and not ended. Its seal also
covers the commitment. A command that changes the folder holds it.
"""

import errno
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from deltaswarm_orchestrator.base import seal
from deltaswarm_orchestrator.base.exits import FAILED, CommandError, notice
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError
from deltaswarm_sessions.folder import RECORD

ROSTER = "roster.json"
"""In the folder of all sessions."""

COMMITMENT = "commitment.json"
"""Beside it: keep it secret until the study is published."""

WAIT_S = 30.0
"""How long a command waits for another one that holds the folder."""
POLL_S = 0.05


class Withdrawn(NamedTuple):
    """A participant who withdrew."""

    participant: int
    date: str
    reason: str


class Roster(NamedTuple):
    """What `roster.json` holds."""

    withdrawn: tuple[Withdrawn, ...] = ()
    tables: tuple[str, ...] = ()
    """Folders to which tables of the data were written."""
    begun: tuple[int, ...] = ()
    """Participants whose sessions were begun here and who did not withdraw."""
    unfinished: tuple[int, ...] = ()
    """What a command has begun and not ended: one participant's withdrawal, or the correction of the first number."""

    @property
    def used(self) -> set[int]:
        """Numbers that must not be given to anybody else."""
        return {*self.begun, *(one.participant for one in self.withdrawn), *self.unfinished}

    @property
    def option(self) -> str:
        """The option that finishes what is unfinished."""
        return " ".join(["--withdraw" if len(self.unfinished) == 1 else "--renumber", *map(str, self.unfinished)])


def read(sessions: Path) -> Roster:
    """Return what is noted of a folder of sessions; nothing if there is no note.

    Raises:
        CommandError: the note cannot be read, or it, or the commitment, is not as it was sealed.
    """
    content = seal.checked(sessions / ROSTER)
    try:
        rows = tuple(Withdrawn(**row) for row in content.get("withdrawn", ()))
        return Roster(rows, *(tuple(content.get(name, ())) for name in Roster._fields[1:]))
    except TypeError as error:
        raise CommandError(f"{sessions / ROSTER} must be as a command wrote it ({error}); restore it") from None


def write(sessions: Path, roster: Roster) -> None:
    """Note what is known of a folder of sessions."""
    content = roster._asdict() | {"withdrawn": [one._asdict() for one in roster.withdrawn]}
    files = [COMMITMENT] if (sessions / COMMITMENT).exists() else []
    seal.write_sealed(sessions / ROSTER, content, seal.digests(sessions, files))


@contextmanager
def held(sessions: Path, *, only_reads: bool = False) -> Iterator[bool]:
    """Hold a folder of sessions, so that one command at a time changes it. Yield whether it can be written.

    It cannot if there is no such folder or, with `only_reads`, if this process may not write to it.

    Raises:
        CommandError: another command holds it for longer than `WAIT_S`, or its roster is missing.
    """
    if not sessions.is_dir():
        yield False
        return
    lock = _locked(sessions, only_reads)
    try:
        if problem := doubt(sessions):
            if not only_reads and not (sessions / ROSTER).exists():
                raise CommandError(f"{problem}; restore it")
            notice(problem)
        yield lock is not None
    finally:
        if lock is not None:
            lock.release()


def doubt(sessions: Path) -> str:
    """Say why nobody can tell who began and who withdrew; empty if the roster does."""
    file = sessions / ROSTER
    if file.exists():
        is_sealed = seal.SEAL in seal.read_sealed(file)
        return "" if is_sealed else f"{file}: not sealed, so nobody can tell whether it was changed"
    records = sessions.glob(f"participant-*/{RECORD}")
    if any("begun" in seal.read_sealed(record) for record in records):  # those of earlier versions have none
        return f"{file} is missing, so nobody can tell who withdrew, or who began and is no longer there"
    return ""


def _locked(sessions: Path, only_reads: bool) -> FolderLock | None:
    deadline = time.monotonic() + WAIT_S
    while True:
        try:
            return FolderLock(sessions)
        except HeldError as error:
            if time.monotonic() >= deadline:
                raise CommandError(
                    f"{sessions} must be free: another command is at work on its sessions{error}; "
                    "give this command again when that has ended",
                    FAILED,
                ) from None
            time.sleep(POLL_S)
        except OSError as error:
            if only_reads and error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
                return None
            raise
