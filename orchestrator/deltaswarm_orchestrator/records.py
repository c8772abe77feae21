"""The records of an MCAP file, whole or cut off anywhere."""

import struct
from collections.abc import Iterator
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import McapRecord
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

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
