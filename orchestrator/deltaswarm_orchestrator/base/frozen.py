"""What is frozen before there are data: entries whose hashes cover their content, and how two versions of it differ.

Protocols of studies and commitments of sessions consist of such entries. An entry's hash also covers a name and the
hash of the entry before it, so it shows if an entry was edited or removed by hand.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from deltaswarm_wire.files import write_whole

Table = dict[str, Any]
Entry = Mapping[str, Any]

HASH = "hash"

ABSENT = "not there"
MAX_SHOWN = 200
"""Maximum number of characters of a value in a difference."""


class Difference(NamedTuple):
    """A key that differs between two versions, with both values as text."""

    key: str
    old: str
    new: str

    def __str__(self) -> str:
        return f"{self.key} was {self.old}, is {self.new}"


def differences(old: Table, new: Table, path: str = "") -> Iterator[Difference]:
    """Yield the differences of two tables by dotted key. A key that is None counts as absent."""
    for name in {**old, **new}:
        was, now = old.get(name), new.get(name)
        if isinstance(was, dict) and isinstance(now, dict):
            yield from differences(was, now, f"{path}{name}.")
        elif was != now:
            yield Difference(f"{path}{name}", _shown(was), _shown(now))


def changed_keys(old: Table, new: Table) -> list[str]:
    """Return the dotted keys in which two tables differ."""
    return [change.key for change in differences(old, new)]


def _shown(value: Any) -> str:
    if value is None:
        return ABSENT
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


def as_read(table: Any) -> Table:
    """Return a table as JSON gives it back."""
    return dict(json.loads(json.dumps(table)))


def hash_of(entry: Entry, name: str, before: str = "") -> str:
    """Return the SHA-256 of an entry in canonical form; `before` is the hash of the entry before it."""
    content = {key: value for key, value in entry.items() if key != HASH}
    return hashlib.sha256(json.dumps([name, before, content], sort_keys=True).encode()).hexdigest()


def hashes_of(entries: Sequence[Entry], name: str) -> list[str]:
    """Return the hash that each entry of a chain must have."""
    hashes: list[str] = []
    for entry in entries:
        hashes.append(hash_of(entry, name, hashes[-1] if hashes else ""))
    return hashes


def check_entry(entry: Entry, kinds: Mapping[str, type]) -> None:
    """Raise as `check_kinds` does, or ValueError if the entry's date is none."""
    check_kinds(entry, kinds)
    time_of(entry["date"])


def check_kinds(table: Entry, kinds: Mapping[str, type]) -> None:
    """Raise LookupError, TypeError or ValueError unless a table has these keys, with values of these types."""
    if wrong := [name for name, kind in kinds.items() if not isinstance(table[name], kind)]:
        raise ValueError(f"wrong {', '.join(wrong)}")


def time_of(date: str) -> datetime:
    """Parse a date. Raises ValueError if it is not a date with a time zone."""
    time = datetime.fromisoformat(date)
    if time.tzinfo is None:
        raise ValueError(f"{date!r} has no time zone")
    return time


def write(file: Path, record: Table, mode: int | None = None) -> Path:
    """Write an entry, or a record of several; return the file."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(record, indent=2, ensure_ascii=False).encode() + b"\n", mode)
    return file
