"""Tables of the acts and answers of the person at the station: a row per act, a row per answer."""

import csv
import os
from collections.abc import Mapping
from pathlib import Path

from deltaswarm_operator.core.console import Console, OperatorAction
from deltaswarm_operator.core.probes import ProbeRow

ACTIONS, PROBES = "actions.csv", "probes.csv"


class ActionLog:
    """`actions.csv` and `probes.csv`; each row is written as soon as it is known.

    With `sizes` it continues the tables of a killed operator, cut back to these lengths [bytes].
    """

    def __init__(self, folder: Path, sizes: Mapping[str, int] | None = None) -> None:
        for name, size in (sizes or {}).items():
            os.truncate(folder / name, size)
        self._streams = [
            (folder / name).open("a" if sizes else "w", newline="", encoding="utf-8") for name in (ACTIONS, PROBES)
        ]
        self._actions, self._probes = (csv.writer(stream) for stream in self._streams)
        if not sizes:
            self._actions.writerow(OperatorAction._fields)
            self._probes.writerow(ProbeRow._fields)
        self._written = 0

    def write(self, console: Console) -> bool:
        """Write the new rows; return whether there are any."""
        if not console.actions and len(console.probes.rows) == self._written:
            return False
        while console.actions:
            self._actions.writerow(console.actions.popleft())
        self._probes.writerows(console.probes.rows[self._written :])
        self._written = len(console.probes.rows)
        for stream in self._streams:
            stream.flush()
        return True

    def sync(self) -> None:
        """Force all rows to disk."""
        for stream in self._streams:
            stream.flush()
            os.fsync(stream.fileno())

    @property
    def sizes(self) -> dict[str, int]:
        """The lengths of the tables by name [bytes], to continue them from."""
        return {name: stream.tell() for name, stream in zip((ACTIONS, PROBES), self._streams, strict=True)}

    def close(self, console: Console) -> None:
        """Write the remaining rows and close the files."""
        self.write(console)
        for stream in self._streams:
            stream.close()
