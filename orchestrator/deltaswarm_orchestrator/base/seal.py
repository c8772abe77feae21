"""Seals: a JSON record that binds a folder's files to the run that made them, and shows a later change of either.

A sealed record has an entry `seal`: length and SHA-256 of each file that it vouches for, and the SHA-256 of the whole
record. A seal shows damage, edits, and files of other runs. It does not stop somebody who makes a new seal. Recordings
(MCAP) are left out, since they have checksums of their own and name their run.
"""

import hashlib
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.base.exits import CommandError
from deltaswarm_wire.files import write_whole

MANIFEST, RECORD = "manifest.json", "seal.json"
"""The sealed record of a run or a sweep, and that of tables which have no manifest."""

SEAL, FILES, SHA256 = "seal", "files", "sha256"

COPY = ".parquet"
"""Ending of tables that may be missing: each is a copy of the CSV file beside it, and is left out of repositories."""


MAX_NAMED = 3
"""Maximum number of files named in a message."""

_NOT_WHOLE = "{} must be a whole JSON object ({}); restore it, or move it away"


class SealError(CommandError):
    """A file is not as it was sealed; the text says which, what differs, and what to do."""


def sealed(content: Mapping[str, Any], files: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """Return a record with its seal. An earlier seal is replaced."""
    record = {**{name: value for name, value in content.items() if name != SEAL}, SEAL: {FILES: dict(files)}}
    record[SEAL][SHA256] = _digest(record)
    return record


def write_sealed(file: Path, content: Mapping[str, Any], files: Mapping[str, Sequence[Any]]) -> None:
    write_whole(file, json.dumps(sealed(content, files), indent=2).encode() + b"\n")


def digests(folder: Path, names: Iterable[str]) -> dict[str, tuple[int, str]]:
    """Return length [bytes] and SHA-256 of files in a folder. Raises OSError."""
    return {name: digest_of((folder / name).read_bytes()) for name in sorted(names)}


def digest_of(data: bytes) -> tuple[int, str]:
    """Return length [bytes] and SHA-256 of a file's content."""
    return len(data), hashlib.sha256(data).hexdigest()


def read_sealed(file: Path) -> dict[str, Any]:
    """Return a record, sealed or not; {} if there is none."""
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise SealError(_NOT_WHOLE.format(file, getattr(error, "strerror", None) or error)) from None
    if not isinstance(record, dict):
        raise SealError(_NOT_WHOLE.format(file, f"it holds a {type(record).__name__}"))
    if SEAL in record and not _is_whole(record):
        raise SealError(f"{file} was changed or damaged after it was sealed; {_advice(file)}")
    return record


def files_of(record: Mapping[str, Any]) -> dict[str, Sequence[Any]]:
    """Return the files that a record vouches for, with length and digest; none if it has no seal."""
    return dict(record.get(SEAL, {}).get(FILES, {}))


def checked(file: Path, *, deleted: Collection[str] = ()) -> dict[str, Any]:
    """Return a record as `read_sealed` does, after a check of every file that it vouches for, but those `deleted`."""
    record = read_sealed(file)
    sealed = {name: was for name, was in files_of(record).items() if name not in deleted}
    if wrong := [problem for name, was in sealed.items() if (problem := _problem(file.parent / name, was))]:
        more = [f"{len(wrong) - MAX_NAMED} more files differ"] if len(wrong) > MAX_NAMED else []
        raise SealError("; ".join([*wrong[:MAX_NAMED], *more, _advice(file)]))
    return record


def not_sealed(record: Mapping[str, Any], names: Iterable[str]) -> list[str]:
    """Return those of some files that a record does not vouch for."""
    return sorted(set(names) - set(files_of(record)))


def _problem(file: Path, was: Sequence[Any]) -> str:
    """Say how a file differs from what was sealed; empty if it does not."""
    try:
        size, digest = digest_of(file.read_bytes())
    except FileNotFoundError:
        return "" if file.suffix == COPY and file.with_suffix(".csv").exists() else f"{file} is missing"
    except OSError as error:
        return f"{file} cannot be read: {error.strerror}"
    if [size, digest] == list(was):
        return ""
    how = f"has {size} bytes instead of {was[0]}" if size != was[0] else f"has other content of the same {size} bytes"
    return f"{file} {how}"


def _advice(record: Path) -> str:
    what = f"delete {record}" if record.name == RECORD else f"delete the entry {SEAL!r} in {record}"
    return f"restore what was written, or {what} to go on with results that nothing vouches for"


def _is_whole(record: dict[str, Any]) -> bool:
    seal = record[SEAL]
    if not isinstance(seal, dict) or not isinstance(seal.get(FILES), dict):
        return False
    return bool(seal.get(SHA256) == _digest({**record, SEAL: {FILES: seal[FILES]}}))


def _digest(record: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(record).encode()).hexdigest()
