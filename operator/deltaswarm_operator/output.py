"""What the operator leaves: `operator.csv` and `operator.json`."""

import csv
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

FLUSH_EVERY_S = 1.0
"""Rows reach the file at least this often [wall s]."""


class Output:
    """`operator.csv`, a row per step, and at the end `operator.json`. Nothing there is overwritten."""

    def __init__(self, folder: Path, columns: Sequence[str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._totals_file = folder / "operator.json"
        self._stream = (folder / "operator.csv").open("x", newline="")
        self._table = csv.writer(self._stream)
        self._table.writerow(columns)
        self._flush_due = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.close()

    def row(self, values: Sequence[Any]) -> None:
        """Add a step's row."""
        self._table.writerow(values)
        if time.monotonic() >= self._flush_due:
            self.flush()

    def flush(self) -> None:
        """Hand what was written to the operating system."""
        self._stream.flush()
        self._flush_due = time.monotonic() + FLUSH_EVERY_S

    def finish(self, totals: Mapping[str, Any]) -> None:
        """Write the totals, whole or not at all."""
        self.flush()
        part = self._totals_file.with_name("operator.json.part")
        part.write_text(json.dumps(totals, indent=2, allow_nan=False) + "\n")
        part.replace(self._totals_file)
