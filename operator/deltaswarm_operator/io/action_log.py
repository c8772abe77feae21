"""Tables of the acts and answers of the person at the station: a row per act, a row per answer."""

import csv
import os
from collections.abc import Sequence
from pathlib import Path

from deltaswarm_operator.core.console import Console, OperatorAction
from deltaswarm_operator.core.probes import ProbeRow

ACTIONS, PROBES = "actions.csv", "probes.csv"


class ActionLog:
    """`actions.csv` and `probes.csv`; each row is written as soon as it is known.

    With `sizes` it continues the tables of a killed operator, cut back to these lengths [bytes].
    """

    def __init__(self, folder: Path, sizes: Sequence[int] = ()) -> None:
        files = [folder / name for name in (ACTIONS, PROBES)]
        for file, size in zip(files, sizes, strict=False):
            os.truncate(file, size)
        self._streams = [file.open("a" if sizes else "w", newline="") for file in files]
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
    def sizes(self) -> list[int]:
        """The lengths of the tables [bytes], to continue them from."""
        return [stream.tell() for stream in self._streams]

    def close(self, console: Console) -> None:
        """Write the remaining rows and close the files."""
        self.write(console)
        for stream in self._streams:
            stream.close()
