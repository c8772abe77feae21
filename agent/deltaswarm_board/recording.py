"""Records sent and received frames as MCAP files of bounded length. Needs `mcap` (extra `mcap`)."""

import time
from pathlib import Path
from typing import Any, BinaryIO

from mcap.writer import CompressionType, Writer

CHUNK_BYTES = 64 * 1024
"""Maximum loss when the board loses power."""

SLACK = 1.1
"""A full file is a little longer than its limit, by its last frame and its index."""


class FrameRecorder:
    """Writes `<name>.mcap` into a folder; what is full, or from before a restart, becomes `<name>.1.mcap`, `.2`, ...

    The oldest files, which have the smallest numbers, are deleted once all are longer than `backups` full ones. So
    short files of many restarts leave a long one of a flight alone.

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
        """Give the newest file the next number, and delete the oldest ones that there is no room for."""
        numbers = [file.name[len(self._name) + 1 : -len(".mcap")] for file in self._folder.glob(f"{self._name}.*.mcap")]
        older = sorted(int(number) for number in numbers if number.isdecimal())
        if self._file(0).exists():
            older.append(older[-1] + 1 if older else 1)
            self._file(0).replace(self._file(older[-1]))
        left_bytes = sum(self._file(number).stat().st_size for number in older)
        for number in older[:-1]:
            if left_bytes <= self._backups * self._max_bytes * SLACK:
                break
            left_bytes -= self._file(number).stat().st_size
            self._file(number).unlink()

    def _open(self) -> None:
        self._stream: BinaryIO = self._file(0).open("wb")
        self._writer: Any = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        self._writer.start(library="deltaswarm")
        self._channels: dict[str, int] = {}
        self._bytes = 0
