"""The participants of a folder of sessions: who is there, who withdrew, wrong numbers, and which number comes next.

What changes more than one file is noted before it begins and after it ended, so that the next command can finish it.
The caller holds the folder of sessions (`ledger.held`).
"""

import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.recording import PART
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError, is_held
from deltaswarm_sessions import MAX_PARTICIPANT, ledger
from deltaswarm_sessions.folder import RECORD, folder_name, intact_record, read_record
from deltaswarm_sessions.ledger import Withdrawn
from deltaswarm_sessions.plan import allocation_of
from deltaswarm_sessions.settings import SessionSettings

PILOT = "pilot"
"""The folder of a pilot's sessions, in that of the study."""

BEYOND_REACH = "copies, back-ups, exports, repositories, and whatever was published"
"""Where a withdrawn participant's data may also be."""

OF_TABLES = (seal.RECORD, "participants.tsv", f"tables{PART}")
"""What tells that a folder has tables, even if a command that wrote them was killed."""


class Removed(NamedTuple):
    """What a withdrawal did."""

    folder: Path | None
    """The folder that was removed; None: there was none."""
    tables: list[Path]
    """Folders of tables that must be written again, without the participant."""
    not_there: list[Path]
    """Folders to which tables were written and which are no longer there."""


def note_tables(sessions: Path, out: Path) -> None:
    """Note where tables will be written, so that a withdrawal finds them, and of whom: folders may have been copied."""
    roster = ledger.read(sessions)
    there = [file.parent.name.rpartition("-")[2] for file in sessions.glob(f"participant-*/{RECORD}")]
    tables = dict.fromkeys((*roster.tables, str(out.resolve())))
    begun = dict.fromkeys((*roster.begun, *sorted(int(text) for text in there if text.isdecimal())))
    ledger.write(sessions, roster._replace(tables=tuple(tables), begun=tuple(begun)))


def note_begun(sessions: Path, participant: int) -> None:
    """Note that a participant's session was begun."""
    roster = ledger.read(sessions)
    if participant not in roster.begun:
        ledger.write(sessions, roster._replace(begun=(*roster.begun, participant)))


def check_number(sessions: Path, participant: int) -> None:
    """Refuse the number of a participant who withdrew, or which is being corrected. Raises CommandError."""
    roster = ledger.read(sessions)
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


def withdraw(sessions: Path, participant: int, reason: str) -> Removed:
    """Remove all that a participant left in a folder of sessions; number, date and reason stay.

    The withdrawal is unfinished until the tables have been written again and `ledger` says so.

    Raises:
        CommandError: nothing is known of this participant, a session is under way, or the folder cannot be removed.
    """
    roster, folder = ledger.read(sessions), sessions / folder_name(participant)
    is_known = any(one.participant == participant for one in roster.withdrawn)
    if not folder.exists() and not is_known and participant not in roster.begun:
        raise CommandError(f"--withdraw must be a participant with a session in {sessions} (got {participant})")
    if not is_known:
        row = Withdrawn(participant, provenance.now(), " ".join(reason.split()))
        roster = roster._replace(withdrawn=(*roster.withdrawn, row))
    roster = roster._replace(begun=tuple(number for number in roster.begun if number != participant))
    tables = [Path(name) for name in roster.tables]
    there = [one for one in tables if any((one / name).exists() for name in OF_TABLES)]
    removed = Removed(folder if folder.exists() else None, there, [one for one in tables if one not in there])
    with _held(folder):
        ledger.write(sessions, roster._replace(unfinished=(participant,)))
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
    """Give a participant who began under a wrong number the right one; the order of the runs stays. Return the folder.

    Raises:
        CommandError: there is no such session, it is under way, or the new number is in use.
    """
    roster = ledger.read(sessions)
    folder, target = sessions / folder_name(old), sessions / folder_name(new)
    if roster.unfinished and folder.exists() == target.exists():  # nothing was moved yet, or more was by hand
        ledger.write(sessions, roster := roster._replace(unfinished=()))
    if not roster.unfinished:
        if not (folder / RECORD).exists():
            raise CommandError(f"--renumber must begin with a participant who has a session in {sessions} (got {old})")
        if target.exists():
            raise CommandError(f"--renumber must end with a number that is free ({target} exists)")
        check_number(sessions, new)
    with _held(folder if folder.exists() else target):
        if folder.exists():
            read_record(folder)
            ledger.write(sessions, roster._replace(unfinished=(old, new)))
            folder.rename(target)
        record = intact_record(target)
        if record["participant"] == old:
            corrected = [*record.get("corrected", ()), {"from": old, "to": new, "date": provenance.now()}]
            content = {**record, "participant": new, "allocated": allocated(record), "corrected": corrected}
            seal.write_sealed(target / RECORD, content, seal.files_of(record))
        begun = (*(number for number in roster.begun if number not in (old, new)), new)
        ledger.write(sessions, roster._replace(begun=begun, unfinished=()))
    return target


def allocated(record: dict[str, Any]) -> int:
    """Return the number that decided a participant's order: a wrong one, if it was corrected."""
    return int(record.get("allocated", record["participant"]))


def next_number(settings: SessionSettings, sessions: Path) -> dict[str, Any]:
    """Return the free number whose order and streams were done least often, and which sessions count.

    Sessions that are complete or under way count; one that was begun and left does not, until it is continued.
    """
    counted: list[dict[str, Any]] = []
    left: list[dict[str, Any]] = []
    roster = ledger.read(sessions)
    used = roster.used
    for file in sorted(sessions.glob(f"participant-*/{RECORD}")):
        record = read_record(file.parent)
        used |= {record["participant"], allocated(record)}
        is_counted = _is_complete(record) or is_held(file.parent)
        (counted if is_counted else left).append(record)
    done = Counter(allocation_of(settings, allocated(record)) for record in counted)
    free = (number for number in range(1, MAX_PARTICIPANT + 1) if number not in used)
    number = min(free, key=lambda number: (done[allocation_of(settings, number)], number))
    return {
        "next": number,
        "counted": [record["participant"] for record in counted],
        "not_complete": [record["participant"] for record in left],
        "withdrawn": sorted(one.participant for one in roster.withdrawn),
    }


def _is_complete(record: dict[str, Any]) -> bool:
    """Return whether each run after the training has a valid attempt."""
    return all(
        any(one["complete"] and one.get("valid", True) for one in run["attempts"])
        for run in record["runs"]
        if run["place"]
    )


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Hold a participant's folder, if it is there; no session may be under way in it."""
    try:
        lock = FolderLock(folder) if folder.exists() else None
    except HeldError:
        raise CommandError(f"{folder} must be free: a session of this participant is under way") from None
    try:
        yield
    finally:
        if lock:
            lock.release()
