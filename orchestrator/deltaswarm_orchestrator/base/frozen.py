"""What is frozen before there are data: entries whose hashes cover their content, and how two versions of it differ.

Protocols of studies and commitments of sessions are made of such entries. An entry's hash also covers what it is of
and the hash of the entry before it, so an entry that was edited or taken out by hand shows.
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
    """Yield what differs between two tables, by dotted keys. None is as good as no value."""
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


def hash_of(entry: Entry, of: str, before: str = "") -> str:
    """Return the SHA-256 of an entry in canonical form; `before`: the hash of the entry before it."""
    content = {name: value for name, value in entry.items() if name != HASH}
    return hashlib.sha256(json.dumps([of, before, content], sort_keys=True).encode()).hexdigest()


def hashes_of(entries: Sequence[Entry], of: str) -> list[str]:
    """Return the hash that each entry of a chain must have."""
    hashes: list[str] = []
    for entry in entries:
        hashes.append(hash_of(entry, of, hashes[-1] if hashes else ""))
    return hashes


def check_entry(entry: Entry, kinds: Mapping[str, type]) -> None:
    """Check the keys of an entry. Raises LookupError, TypeError, ValueError: one is missing, or of another type."""
    if wrong := [name for name, kind in kinds.items() if not isinstance(entry[name], kind)]:
        raise ValueError(f"wrong {', '.join(wrong)}")
    time_of(entry["date"])


def time_of(date: str) -> datetime:
    """Parse a date. Raises ValueError: it is none, or has no time zone."""
    time = datetime.fromisoformat(date)
    if time.tzinfo is None:
        raise ValueError(f"{date!r} has no time zone")
    return time


def write(file: Path, record: Table, mode: int | None = None) -> Path:
    """Write entries, or a record of them; return the file."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(record, indent=2, ensure_ascii=False).encode() + b"\n", mode)
    return file
