"""Files of tables, written whole or not at all: first into a folder beside those that they replace."""

import io
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from deltaswarm_orchestrator.recording import PART
from deltaswarm_wire.cells import TableWriter
from deltaswarm_wire.files import write_whole


@contextmanager
def staged(out: Path) -> Iterator[Path]:
    """Make a new folder beside `out`, from which the caller moves what is complete; delete the rest at the end."""
    part = out.with_name(f"{out.name}{PART}")
    if part.exists():
        shutil.rmtree(part)  # of a command that was killed
    part.mkdir(parents=True)
    try:
        yield part
    finally:
        shutil.rmtree(part)


def write_rows(file: Path, columns: Iterable[str], rows: Iterable[Mapping[str, Any]], delimiter: str) -> None:
    """Write a table, in which no text stands as a formula."""
    stream, names = io.StringIO(newline=""), list(columns)
    table = TableWriter(stream, delimiter, "\n")
    table.writerow(names)
    table.writerows([row.get(name, "") for name in names] for row in rows)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, stream.getvalue().encode())
