"""The records of an MCAP file, whole or cut off anywhere, and the figures in them."""

import struct
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.records import McapRecord
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from deltaswarm_orchestrator.recording.foxglove import NOT_YET
from deltaswarm_wire.messages import Event, Workload
from deltaswarm_wire.truth import EventState, Tally

_MAGIC = b"\x89MCAP0\r\n"

_DAMAGE = (McapError, ZstdError, struct.error, ValueError, OverflowError, MemoryError)
"""What a file that was cut off or damaged can raise when it is read."""


class RecordingError(ValueError):
    """A file that is no recording."""


def records(path: Path) -> Iterator[McapRecord | None]:
    """Each record in turn, up to the end, or to where the file is damaged: then None is the last.

    Raises:
        FileNotFoundError: there is none.
        RecordingError: the file is no MCAP file.
    """
    size_bytes = path.stat().st_size
    with path.open("rb") as stream:
        if not _MAGIC.startswith(stream.read(len(_MAGIC))):
            raise RecordingError(f"{path} is no MCAP file")
        stream.seek(0)
        found = StreamReader(stream, validate_crcs=True, record_size_limit=size_bytes).records
        while True:
            try:
                record = next(found, None)
            except _DAMAGE:
                yield None
                return
            if record is None:
                return
            yield record


def row_of(kind: Any, values: Mapping[str, Any]) -> Any:
    """A named tuple of the wire from its figures; what is NOT_YET is None where None is possible."""
    hints = _HINTS[kind]
    return kind(*[None if values[name] == NOT_YET and hints[name] == float | None else values[name] for name in hints])


_HINTS = {kind: typing.get_type_hints(kind) for kind in (Tally, EventState, Workload, Event)}
