"""Read the records of an MCAP file, complete or cut off anywhere, and decode their messages."""

import struct
from collections.abc import Callable, Container, Iterator, Mapping
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory
from zstandard import ZstdError

_MAGIC = b"\x89MCAP0\r\n"

_DAMAGE = (McapError, ZstdError, struct.error, ValueError, OverflowError, MemoryError)
"""The exceptions that reading a truncated or damaged file can raise."""


class RecordingError(ValueError):
    """The file is not a usable recording."""


def records(path: Path) -> Iterator[McapRecord | None]:
    """Yield each record up to the end of the file, or up to the first damage and then None.

    Raises:
        FileNotFoundError: there is no file.
        RecordingError: the file is not an MCAP file.
    """
    size_bytes = path.stat().st_size
    with path.open("rb") as stream:
        if not _MAGIC.startswith(stream.read(len(_MAGIC))):
            raise RecordingError(f"{path} is not an MCAP file")
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


class Messages:
    """Decodes a file's messages on some topics, each by the schema that the file itself holds."""

    def __init__(self, topics: Container[str]) -> None:
        self._topics = topics
        self._factory = DecoderFactory()
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, tuple[str, Callable[[bytes], Any]]] = {}

    def take(self, record: McapRecord) -> tuple[str, Any] | None:
        """Return topic and message if the record is a message on one of the topics.

        Raises:
            RecordingError: one of the topics is not in protobuf, as in recordings of earlier versions.
        """
        if isinstance(record, Message):
            topic, decode = self._channels.get(record.channel_id, ("", None))
            return (topic, decode(record.data)) if decode else None
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel) and record.topic in self._topics:
            decode = self._factory.decoder_for(record.message_encoding, self._schemas.get(record.schema_id))
            if decode is None:
                raise RecordingError(f"{record.topic} must be in protobuf (got {record.message_encoding})")
            self._channels[record.id] = record.topic, decode
        return None


def values_of(message: Any) -> dict[str, Any]:
    """Return the fields of a message by name; None for absent fields."""
    return {
        field.name: None if field.has_presence and not message.HasField(field.name) else getattr(message, field.name)
        for field in message.DESCRIPTOR.fields
    }


def row_of(kind: Any, values: Mapping[str, Any]) -> Any:
    """Make a named tuple of the wire from the values of its fields."""
    return kind(*[values[name] for name in kind._fields])
