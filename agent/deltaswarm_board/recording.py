"""Records sent and received frames as MCAP files of bounded length. Needs `mcap` (extra `mcap`)."""

import time
from pathlib import Path
from typing import Any, BinaryIO

from mcap.writer import CompressionType, Writer

CHUNK_BYTES = 64 * 1024
"""Maximum loss when the board loses power."""


class FrameRecorder:
    """Writes `<name>.mcap` into a folder; a full file becomes `<name>.1.mcap`, and so on up to `backups`.

    Topics are the samples' keys, messages the samples as sent (MessagePack), times the board's wall clock.
    """

    def __init__(self, folder: Path, name: str, max_bytes: int, backups: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._name = folder, name
        self._max_bytes, self._backups = max_bytes, backups
        self._roll()
        self._open()

    def write(self, topic: str, data: bytes) -> None:
        now_ns = time.time_ns()
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "msgpack", schema_id=0)
        self._writer.add_message(self._channels[topic], log_time=now_ns, data=data, publish_time=now_ns)
        self._bytes += len(data) + 64
        if self._bytes >= self._max_bytes:
            self.close()
            self._roll()
            self._open()

    def close(self) -> None:
        """Finish the file, unless it is finished: a next one could not be opened."""
        if not self._stream.closed:
            self._writer.finish()
            self._stream.close()

    def _file(self, number: int) -> Path:
        return self._folder / (f"{self._name}.{number}.mcap" if number else f"{self._name}.mcap")

    def _roll(self) -> None:
        """Rename each file to the next older name, which deletes the oldest."""
        for number in reversed(range(self._backups)):
            if self._file(number).exists():
                self._file(number).replace(self._file(number + 1))

    def _open(self) -> None:
        self._stream: BinaryIO = self._file(0).open("wb")
        self._writer: Any = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        self._writer.start(library="deltaswarm")
        self._channels: dict[str, int] = {}
        self._bytes = 0
