"""The operator's files: `operator.csv`, `operator.json`, and during the run `operator-state.json` to resume from."""

import base64
import csv
import json
import os
import pickle
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from deltaswarm_wire import checkpoint

FLUSH_EVERY_S = 1.0
"""Rows reach the file at least this often [wall s]."""

TABLE, TOTALS, STATE = "operator.csv", "operator.json", "operator-state.json"


class OperatorFiles:
    """Writes `operator.csv`, a row per step, and at the end `operator.json`. Never overwrites.

    With `go_on` it continues the table of an operator that ended early after the last confirmed row.
    """

    def __init__(self, folder: Path, columns: Sequence[str], *, go_on: bool = False) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._flush_due = 0.0
        self.state: Any = None
        """State confirmed by the previous operator, to resume from."""
        self.rows_before: list[list[str]] = []
        """Rows of the table confirmed by the previous operator."""
        if go_on and (folder / STATE).exists():
            saved = json.loads((folder / STATE).read_text(encoding="utf-8"))
            self.state = pickle.loads(base64.b64decode(saved["state"]))
            os.truncate(folder / TABLE, saved["table_bytes"])
            with (folder / TABLE).open(newline="", encoding="utf-8") as table:
                self.rows_before = list(csv.reader(table))[1:]
        mode = "a" if self.state is not None else "w" if go_on else "x"
        self._stream = (folder / TABLE).open(mode, newline="", encoding="utf-8")
        self._table = csv.writer(self._stream)
        if self.state is None:
            self._table.writerow(columns)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def row(self, values: Sequence[Any]) -> None:
        self._table.writerow(values)
        if time.monotonic() >= self._flush_due:
            self.flush()

    def flush(self) -> None:
        self._stream.flush()
        self._flush_due = time.monotonic() + FLUSH_EVERY_S

    def save(self, state: Any) -> None:
        """Write all rows so far, and pickle the state, from which an operator can resume."""
        self.flush()
        pickled = base64.b64encode(pickle.dumps(state)).decode()
        self._write(STATE, {"table_bytes": self._stream.tell(), "state": pickled})

    def checkpoint(self, step: int, other_tables: Mapping[str, int]) -> None:
        """Copy the state just saved for this step into a checkpoint; seal all tables, the others up to these sizes."""
        os.fsync(self._stream.fileno())
        state = json.loads((self._folder / STATE).read_text(encoding="utf-8"))
        state["tables"] = checkpoint.table_seals(self._folder, {TABLE: self._stream.tell(), **other_tables})
        file = self._folder / checkpoint.FOLDER / str(step) / checkpoint.OPERATOR_FILE
        checkpoint.write(file, json.dumps(state).encode())

    def totals(self, totals: Mapping[str, Any]) -> None:
        """Write all rows so far, and the totals atomically."""
        self.flush()
        self._write(TOTALS, totals)

    def finish(self, totals: Mapping[str, Any]) -> None:
        """Write the totals; if they are `complete`, remove the state, from which no other operator will resume."""
        self.totals(totals)
        if totals["complete"]:
            (self._folder / STATE).unlink(missing_ok=True)

    def _write(self, name: str, value: Mapping[str, Any]) -> None:
        part = self._folder / f"{name}.part"
        part.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        part.replace(self._folder / name)
