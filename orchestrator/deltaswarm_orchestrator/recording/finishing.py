"""Complete a recording that was cut off with its index and its end, so that every MCAP reader opens it."""

from pathlib import Path
from typing import IO

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import Writer

from deltaswarm_orchestrator.recording import MANIFEST, SCENARIO
from deltaswarm_orchestrator.recording.reader import Damage, RecordingError, check_origin, records

CHUNK_BYTES = 256 * 1024


def new_writer(stream: IO[bytes], profile: str = "", library: str = "deltaswarm") -> Writer:
    """Begin an MCAP file as all of ours are: in chunks, with checksums."""
    writer = Writer(stream, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
    writer.start(profile, library)
    return writer


def write_complete_copy(source: Path, target: Path) -> bool:
    """Copy everything up to the first damage into a file with its end; return whether the recording was complete."""
    is_complete = False
    schemas, channels = {0: 0}, dict[int, int]()
    with target.open("wb") as stream:
        writer = new_writer(stream)
        for record in records(source):
            match record:
                case Schema() if record.id not in schemas:
                    schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
                case Channel() if record.id not in channels:
                    schema = schemas[record.schema_id]
                    channels[record.id] = writer.register_channel(
                        record.topic, record.message_encoding, schema, record.metadata
                    )
                case Message():
                    channel = channels[record.channel_id]
                    writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
                case Attachment():
                    if record.name == SCENARIO:
                        check_origin(source, record.name, record.data)
                    times = record.create_time, record.log_time
                    writer.add_attachment(*times, record.name, record.media_type, record.data)
                case Metadata():
                    if record.name == MANIFEST:
                        check_origin(source, record.name, record.metadata)
                    writer.add_metadata(record.name, record.metadata)
                    is_complete |= record.name == MANIFEST
                case Damage():
                    is_complete = False
        writer.finish()  # type: ignore[no-untyped-call]
    return is_complete


def is_cut_off(file: Path) -> bool:
    """Return whether a recording is there and lacks its end alone."""
    try:
        return file.exists() and Damage(is_at_the_end=True) in records(file)
    except RecordingError:
        return False
