"""The participants of a folder of sessions, `roster.json`: who began, who withdrew, and which number comes next.

The roster also notes where tables were written and which command was interrupted, so that the next command can finish
it; its seal covers the commitment, too. A command that changes the folder holds it (`held`).
"""

import errno
import os
import shutil
import time
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_orchestrator.base.exits import FAILED, CommandError, notice
from deltaswarm_orchestrator.recording import PART
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError, is_held
from deltaswarm_sessions import MAX_PARTICIPANT
from deltaswarm_sessions.folder import RECORD, folder_name, intact_record, locked, read_record
from deltaswarm_sessions.plan import group_of, places_of
from deltaswarm_sessions.settings import CROSSED, SessionSettings

ROSTER = "roster.json"
"""In the folder of all sessions."""

COMMITMENT = "commitment.json"
"""Beside it: keep it secret until the study is published."""

PILOT = "pilot"
"""The folder of a pilot's sessions, in that of the study."""

WAIT_S = 30.0
"""How long a command waits for another one that holds the folder."""
POLL_S = 0.05

BEYOND_REACH = "copies, back-ups, exports, repositories, and whatever was published"
"""Where a withdrawn participant's data may also be."""

OF_TABLES = (seal.RECORD, "participants.tsv", f"tables{PART}")
"""What tells that a folder has tables, even if a command that wrote them was killed."""


class Withdrawn(NamedTuple):
    participant: int
    date: str
    reason: str


class Roster(NamedTuple):
    """What `roster.json` holds."""

    withdrawn: tuple[Withdrawn, ...] = ()
    tables: tuple[str, ...] = ()
    """Folders to which tables of the data were written, relative to that of the sessions."""
    begun: tuple[int, ...] = ()
    """Participants whose sessions were begun here and who did not withdraw."""
    unfinished: tuple[int, ...] = ()
    """What an interrupted command was about: the participant who withdraws, or a wrong number and the right one."""

    @property
    def used(self) -> set[int]:
        """Numbers that must not be given to anybody else."""
        return {*self.begun, *(one.participant for one in self.withdrawn), *self.unfinished}

    @property
    def option(self) -> str:
        """The option that finishes the interrupted command."""
        return " ".join(["--withdraw" if len(self.unfinished) == 1 else "--renumber", *map(str, self.unfinished)])


def read(sessions: Path) -> Roster:
    """Return the roster of a folder of sessions; an empty one if there is no file."""
    content = seal.checked(sessions / ROSTER)
    try:
        rows = tuple(Withdrawn(**row) for row in content.get("withdrawn", ()))
        return Roster(rows, *(tuple(content.get(name, ())) for name in Roster._fields[1:]))
    except TypeError as error:
        raise CommandError(f"{sessions / ROSTER} must be as a command wrote it ({error}); restore it") from None


def write(sessions: Path, roster: Roster) -> None:
    """Write and seal the roster, and seal the commitment if there is one."""
    content = roster._asdict() | {"withdrawn": [one._asdict() for one in roster.withdrawn]}
    files = [COMMITMENT] if (sessions / COMMITMENT).exists() else []
    seal.write_sealed(sessions / ROSTER, content, seal.digests(sessions, files))


@contextmanager
def held(sessions: Path, *, only_reads: bool = False) -> Iterator[bool]:
    """Hold a folder of sessions, so that one command at a time changes it. Yield whether it can be written.

    It cannot if there is no such folder, or with `only_reads`: if this process may not write, or the roster is lost.
    """
    if not sessions.is_dir():
        yield False
        return
    lock = _lock(sessions, only_reads)
    try:
        problem = doubt(sessions)
        is_lost = bool(problem) and not (sessions / ROSTER).exists()
        if is_lost and not only_reads:
            raise CommandError(f"{problem}; restore it")
        if problem:
            notice(problem)
        yield lock is not None and not is_lost  # a new roster would hide that the old one is lost
    finally:
        if lock is not None:
            lock.release()


def _lock(sessions: Path, only_reads: bool) -> FolderLock | None:
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


def doubt(sessions: Path) -> str:
    """Say why the roster cannot be trusted; empty if it can."""
    file = sessions / ROSTER
    if file.exists():
        is_sealed = seal.SEAL in seal.read_sealed(file)
        return "" if is_sealed else f"{file}: not sealed, so nobody can tell whether it was changed"
    records = sessions.glob(f"participant-*/{RECORD}")
    if any("begun" in seal.read_sealed(record) for record in records):  # those of earlier versions have none
        return f"{file} is missing, so nobody can tell who withdrew, or who began and is no longer there"
    return ""


def relative(to: Path, folder: Path) -> str:
    """Return the way from a folder to another: it stays right if both are moved or copied together."""
    return os.path.relpath(to.resolve(), folder.resolve())


def is_of(tables: Path, sessions: Path) -> bool:
    """Whether tables were written from this folder of sessions, and not from one of which it is a copy."""
    written_from = seal.read_sealed(tables / seal.RECORD).get("sessions")
    return written_from is None or (tables / written_from).resolve() == sessions.resolve()


def note_tables(sessions: Path, out: Path) -> None:
    """Note where tables will be written, so that a withdrawal finds them, and of whom: folders may have been copied."""
    roster = read(sessions)
    there = [file.parent.name.rpartition("-")[2] for file in sessions.glob(f"participant-*/{RECORD}")]
    tables = dict.fromkeys((*roster.tables, relative(out, sessions)))
    begun = dict.fromkeys((*roster.begun, *sorted(int(text) for text in there if text.isdecimal())))
    write(sessions, roster._replace(tables=tuple(tables), begun=tuple(begun)))


def note_begun(sessions: Path, participant: int) -> None:
    roster = read(sessions)
    if participant not in roster.begun:
        write(sessions, roster._replace(begun=(*roster.begun, participant)))


def check_number(sessions: Path, participant: int) -> None:
    """Refuse the number of a participant who withdrew, or which is being corrected."""
    roster = read(sessions)
    if gone := next((one for one in roster.withdrawn if one.participant == participant), None):
        raise CommandError(
            f"--participant must not be a number that is used up: {participant} withdrew on {gone.date}; "
            "--next prints the number to use"
        )
    if participant in roster.unfinished:
        raise CommandError(
            f"--participant must not be a number whose correction was interrupted (got {participant}); "
            f"{roster.option} finishes it"
        )


class Removed(NamedTuple):
    folder: Path | None
    """The folder that was removed; None: there was none."""
    tables: list[Path]
    """Folders of tables that must be written again, without the participant."""
    not_there: list[Path]
    """Folders to which tables were written, and which are no longer there or were written from another folder."""


def withdraw(sessions: Path, participant: int, reason: str) -> Removed:
    """Remove a participant's folder; number, date and reason stay. The caller holds the folder of sessions.

    The withdrawal is unfinished until the tables have been written again and the roster says so.
    """
    roster, folder = read(sessions), sessions / folder_name(participant)
    is_known = any(one.participant == participant for one in roster.withdrawn)
    if not folder.exists() and not is_known and participant not in roster.begun:
        raise CommandError(f"--withdraw must be a participant with a session in {sessions} (got {participant})")
    if not is_known:
        row = Withdrawn(participant, provenance.now(), " ".join(reason.split()))
        roster = roster._replace(withdrawn=(*roster.withdrawn, row))
    roster = roster._replace(begun=tuple(number for number in roster.begun if number != participant))
    tables = [(sessions / name).resolve() for name in roster.tables]
    there = [one for one in tables if any((one / name).exists() for name in OF_TABLES) and is_of(one, sessions)]
    removed = Removed(folder if folder.exists() else None, there, [one for one in tables if one not in there])
    with ExitStack() as stack:
        if removed.folder:
            stack.callback(locked(folder).release)
        write(sessions, roster._replace(unfinished=(participant,)))
        try:
            if removed.folder:
                shutil.rmtree(folder)
        except OSError as error:
            raise CommandError(
                f"{folder} cannot be removed ({error}); remove what is left, then give the command again: until then "
                f"the withdrawal of {participant} is not finished, and no table is written",
                FAILED,
            ) from None
    return removed


def renumber(sessions: Path, old: int, new: int) -> Path:
    """Correct a participant's number; the order of the runs stays. Return the folder.

    The caller holds the folder of sessions.
    """
    roster = read(sessions)
    folder, target = sessions / folder_name(old), sessions / folder_name(new)
    if roster.unfinished and folder.exists() == target.exists():  # nothing was moved yet, or more was by hand
        write(sessions, roster := roster._replace(unfinished=()))
    if not roster.unfinished:
        if not (folder / RECORD).exists():
            raise CommandError(f"--renumber must begin with a participant who has a session in {sessions} (got {old})")
        if target.exists():
            raise CommandError(f"--renumber must end with a number that is free ({target} exists)")
        check_number(sessions, new)
    lock = locked(folder if folder.exists() else target)
    try:
        if folder.exists():
            read_record(folder)
            write(sessions, roster._replace(unfinished=(old, new)))
            folder.rename(target)
        record = intact_record(target)
        if record["participant"] == old:
            corrected = [*record.get("corrected", ()), {"from": old, "to": new, "date": provenance.now()}]
            content = {**record, "participant": new, "allocated": allocated(record), "corrected": corrected}
            seal.write_sealed(target / RECORD, content, seal.files_of(record))
        begun = (*(number for number in roster.begun if number not in (old, new)), new)
        write(sessions, roster._replace(begun=begun, unfinished=()))
    finally:
        lock.release()
    return target


def allocated(record: dict[str, Any]) -> int:
    """Return the number that decided a participant's order: a wrong one, if it was corrected."""
    return int(record.get("allocated", record["participant"]))


WHOLE = (1, 1)


def next_number(
    settings: SessionSettings, sessions: Path, promised: Collection[int] = (), share: tuple[int, int] = WHOLE
) -> dict[str, Any]:
    """Return the free number whose order and streams were done least often, and the sessions that were counted.

    Sessions that are complete or under way count; one that was begun and left does not, until it is continued.
    `promised` numbers belong to somebody whose session has not begun: they are not free, and count too. `share`: K of N
    folders that share the study; each has every Nth group of numbers, so that it is balanced by itself.
    """
    group = group_of(len(settings.condition), is_crossed=settings.arrivals == CROSSED)
    mine, of = share

    def balanced(number: int) -> tuple[object, ...]:
        return tuple((place.condition.label, place.stream) for place in places_of(settings, number))

    counted: list[dict[str, Any]] = []
    left: list[dict[str, Any]] = []
    roster = read(sessions)
    used = roster.used
    for file in sorted(sessions.glob(f"participant-*/{RECORD}")):
        record = read_record(file.parent)
        used |= {record["participant"], allocated(record)}
        is_counted = _is_complete(record) or is_held(file.parent)
        (counted if is_counted else left).append(record)
    done = Counter(balanced(allocated(record)) for record in counted)
    done.update(balanced(number) for number in promised if number not in used)
    numbers = (number for number in range(1, MAX_PARTICIPANT + 1) if (number - 1) // group % of == mine - 1)
    free = (number for number in numbers if number not in used and number not in promised)
    number = min(free, key=lambda number: (done[balanced(number)], number), default=None)
    if number is None:
        raise CommandError(f"no number up to {MAX_PARTICIPANT} is free (share {mine}/{of} of them)")
    return {
        "next": number,
        "counted": [record["participant"] for record in counted],
        "not_complete": [record["participant"] for record in left],
        "withdrawn": sorted(one.participant for one in roster.withdrawn),
    }


def _is_complete(record: dict[str, Any]) -> bool:
    return all(
        any(one["complete"] and one.get("valid", True) for one in run["attempts"])
        for run in record["runs"]
        if run["place"]
    )
