"""The participants of a folder of sessions: who is there, who withdrew, wrong numbers, and which number comes next."""

import json
import shutil
from collections import Counter
from collections.abc import Iterable
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_orchestrator.base import provenance, seal
from deltaswarm_orchestrator.base.exits import FAILED, CommandError
from deltaswarm_orchestrator.results.folder_lock import FolderLock, HeldError, is_held
from deltaswarm_sessions import MAX_PARTICIPANT
from deltaswarm_sessions.folder import RECORD, folder_name, read_record
from deltaswarm_sessions.plan import allocation_of
from deltaswarm_sessions.settings import SessionSettings
from deltaswarm_wire.files import write_whole

ROSTER = "roster.json"
"""In the folder of all sessions: who withdrew, and where tables of the data were written."""

PILOT = "pilot"
"""The folder of a pilot's sessions, in that of the study."""

BEYOND_REACH = "copies, back-ups, exports, repositories, and whatever was published"
"""Where a withdrawn participant's data may also be."""


class Withdrawn(NamedTuple):
    """A participant who withdrew."""

    participant: int
    date: str
    reason: str


class Removed(NamedTuple):
    """What a withdrawal did."""

    folder: Path | None
    """The folder that was removed; None: there was none."""
    tables: list[Path]
    """Folders of tables that must be written again, without the participant."""
    not_there: list[Path]
    """Folders to which tables were written and which are no longer there."""


def withdrawn_in(sessions: Path) -> list[Withdrawn]:
    """Return who withdrew. Raises CommandError: the roster cannot be read or was changed."""
    return [Withdrawn(**row) for row in _read(sessions)["withdrawn"]]


def note_tables(sessions: Path, out: Path) -> None:
    """Note where tables are written, so that a withdrawal finds them, if the folder can be written."""
    roster = _read(sessions)
    folder = str(out.resolve())
    if folder not in roster["tables"]:
        with suppress(OSError):
            _write(sessions, roster | {"tables": [*roster["tables"], folder]})


def check_number(sessions: Path, participant: int) -> None:
    """Refuse the number of a participant who withdrew. Raises CommandError."""
    if gone := next((one for one in withdrawn_in(sessions) if one.participant == participant), None):
        raise CommandError(
            f"--participant must not be a number that is used up: {participant} withdrew on {gone.date}; "
            "--next prints the number to use"
        )


def withdraw(sessions: Path, participant: int, reason: str) -> Removed:
    """Remove all that a participant left in a folder of sessions; number, date and reason stay.

    Raises:
        CommandError: nothing is known of this participant, a session is under way, or the folder cannot be removed.
    """
    roster, folder = _read(sessions), sessions / folder_name(participant)
    is_known = any(row["participant"] == participant for row in roster["withdrawn"])
    if not folder.exists() and not is_known:
        raise CommandError(f"--withdraw must be a participant with a session in {sessions} (got {participant})")
    tables = [Path(name) for name in roster["tables"]]
    removed = Removed(folder if folder.exists() else None, *_divided(tables))
    if not is_known:
        row = Withdrawn(participant, provenance.now(), " ".join(reason.split()))._asdict()
        roster = roster | {"withdrawn": [*roster["withdrawn"], row]}
    if removed.folder:
        with _held(folder):
            _write(sessions, roster)
            try:
                shutil.rmtree(folder)
            except OSError as error:
                problem = f"{folder} cannot be removed ({error}); remove what is left, then give the command again"
                raise CommandError(problem, FAILED) from None
    return removed


def renumber(sessions: Path, old: int, new: int) -> Path:
    """Give a participant who began under a wrong number the right one; the order of the runs stays. Return the folder.

    Raises:
        CommandError: there is no such session, it is under way, or the new number is in use.
    """
    folder, target = sessions / folder_name(old), sessions / folder_name(new)
    if not (folder / RECORD).exists():
        raise CommandError(f"--renumber must begin with a participant who has a session in {sessions} (got {old})")
    if target.exists():
        raise CommandError(f"--renumber must end with a number that is free ({target} exists)")
    check_number(sessions, new)
    with _held(folder):
        record = read_record(folder)
        corrected = [*record.get("corrected", ()), {"from": old, "to": new, "date": provenance.now()}]
        content = {**record, "participant": new, "allocated": allocated(record), "corrected": corrected}
        folder.rename(target)
        seal.write_sealed(target / RECORD, content, seal.files_of(record))
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
    used = {one.participant for one in withdrawn_in(sessions)}
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
        "withdrawn": sorted(one.participant for one in withdrawn_in(sessions)),
    }


def _is_complete(record: dict[str, Any]) -> bool:
    """Return whether each run after the training has a valid attempt."""
    return all(
        any(one["complete"] and one.get("valid", True) for one in run["attempts"])
        for run in record["runs"]
        if run["place"]
    )


@contextmanager
def _held(folder: Path) -> Any:
    """Hold a participant's folder, in which no session may be under way."""
    try:
        lock = FolderLock(folder)
    except HeldError:
        raise CommandError(f"{folder} must be free: a session of this participant is under way") from None
    try:
        yield
    finally:
        lock.release()


def _divided(tables: Iterable[Path]) -> tuple[list[Path], list[Path]]:
    tables = list(tables)
    return [one for one in tables if (one / seal.RECORD).exists()], [
        one for one in tables if not (one / seal.RECORD).exists()
    ]


def _read(sessions: Path) -> dict[str, Any]:
    roster = {"withdrawn": [], "tables": []} | seal.read_sealed(sessions / ROSTER)
    return {name: roster[name] for name in ("withdrawn", "tables")}


def _write(sessions: Path, roster: dict[str, Any]) -> None:
    write_whole(sessions / ROSTER, json.dumps(roster, indent=2).encode() + b"\n")
