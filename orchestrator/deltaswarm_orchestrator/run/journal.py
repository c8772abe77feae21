"""Every input of a person's run with its moment, on disk before it is carried out: a killed run goes on from it."""

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgpack

BEGIN, SPEAK, STEP, INPUT, LOOK = "begin", "speak", "step", "input", "look"
"""Kinds of rows: the run begins, a process begins to speak to the pages, a step closes, a page sent something, the
pages are looked after."""

BEAT = b'{"type":"beat"'
"""How a sign of life begins, which is no act."""

BOOT = Path("/proc/sys/kernel/random/boot_id")


class Row(NamedTuple):
    kind: str
    wall_s: float
    by: str = ""
    """Whose page sent it."""
    data: bytes | None = None
    """What it sent; None: it has gone."""


@dataclass(frozen=True)
class Header:
    """What a journal belongs to, and the clock by which it was begun."""

    run: str
    """Name of the run for its pages, which keep their inputs for it."""
    identity: str
    """Digest of the code and the files that decide the run: others would not repeat it."""
    boot: str
    wall_s: float
    """A moment of the monotonic clock, and the same in Unix time."""
    unix_s: float

    @classmethod
    def now(cls, run: str, identity: str) -> Self:
        return cls(run, identity, _boot(), time.monotonic(), time.time())

    @property
    def ahead_s(self) -> float:
        """By how much the journal's clock is ahead of this machine's now; 0 while the machine has not restarted."""
        if self.boot == _boot():
            return 0.0
        return self.wall_s + (time.time() - self.unix_s) - time.monotonic()


class Journal:
    """A journal, open to append; `Journal.read` has what was written before.

    Args:
        file: the journal; it is created with the header, or continued.
        header: see there.
        rows: what it holds.
    """

    def __init__(self, file: Path, header: Header, rows: tuple[Row, ...] = ()) -> None:
        self.header, self.rows = header, rows
        mode = os.O_WRONLY | os.O_APPEND | os.O_CREAT | (0 if rows else os.O_EXCL)
        self._file = os.open(file, mode, 0o600)
        if not rows:
            self._write(tuple(vars(header).values()))

    @classmethod
    def read(cls, file: Path) -> tuple[Header, tuple[Row, ...]] | None:
        """Return header and rows; None if there is no journal. A last row that was cut off is cut off in the file."""
        if not file.exists():
            return None
        found = list(_values(file.read_bytes()))
        values = [value for value, _ in found]
        if len(values) < 2:  # killed before the run had begun
            file.unlink()
            return None
        os.truncate(file, found[-1][1])
        return Header(*values[0]), tuple(Row(*value) for value in values[1:])

    def append(self, row: Row) -> None:
        """Write a row; what a person did is on the disk before it is carried out."""
        self._write(row)
        if row.kind == INPUT and not (row.data or b"").startswith(BEAT):
            os.fdatasync(self._file)

    def close(self) -> None:
        os.close(self._file)

    def _write(self, value: tuple[Any, ...]) -> None:
        data = memoryview(msgpack.packb(value))
        while data:
            data = data[os.write(self._file, data) :]


def _values(data: bytes) -> Iterator[tuple[Any, int]]:
    """Yield each whole value with the number of bytes up to its end; what a power cut left is no row, such as zeros."""
    unpacker = msgpack.Unpacker()
    unpacker.feed(data)
    while True:
        try:
            value = unpacker.unpack()
        except (msgpack.OutOfData, ValueError):
            return
        if not isinstance(value, list):
            return
        yield value, unpacker.tell()


def _boot() -> str:
    return BOOT.read_text(encoding="ascii").strip() if BOOT.exists() else ""
