"""Tables of the acts and answers of the person at the station: a row per act, a row per answer."""

import csv
from pathlib import Path

from deltaswarm_operator.core.console import Console, OperatorAction
from deltaswarm_operator.core.probes import ProbeRow

ACTIONS, PROBES = "actions.csv", "probes.csv"


class ActionLog:
    """`actions.csv` and `probes.csv`; each row is written as soon as it is known."""

    def __init__(self, folder: Path, *, go_on: bool) -> None:
        mode = "a" if go_on else "w"
        self._streams = [(folder / name).open(mode, newline="") for name in (ACTIONS, PROBES)]
        self._actions, self._probes = (csv.writer(stream) for stream in self._streams)
        for table, columns in ((self._actions, OperatorAction._fields), (self._probes, ProbeRow._fields)):
            if not go_on:
                table.writerow(columns)
        self._written = 0

    def write(self, console: Console) -> None:
        """Write the new rows."""
        if not console.actions and len(console.probes.rows) == self._written:
            return
        while console.actions:
            self._actions.writerow(console.actions.popleft())
        self._probes.writerows(console.probes.rows[self._written :])
        self._written = len(console.probes.rows)
        for stream in self._streams:
            stream.flush()

    def close(self, console: Console) -> None:
        """Write the remaining rows and close the files."""
        self.write(console)
        for stream in self._streams:
            stream.close()
