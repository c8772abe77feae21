"""Tables of the acts and answers of the person at the station: a row per act, a row per answer."""

import csv
from pathlib import Path

from deltaswarm_operator.desk import Deed, Desk
from deltaswarm_operator.probes import ProbeRow

DEEDS, PROBES = "deeds.csv", "probes.csv"


class DeedTables:
    """`deeds.csv` and `probes.csv`; each row is written as soon as it is known."""

    def __init__(self, folder: Path, *, go_on: bool) -> None:
        mode = "a" if go_on else "w"
        self._streams = [(folder / name).open(mode, newline="") for name in (DEEDS, PROBES)]
        self._deeds, self._probes = (csv.writer(stream) for stream in self._streams)
        for table, columns in ((self._deeds, Deed._fields), (self._probes, ProbeRow._fields)):
            if not go_on:
                table.writerow(columns)
        self._written = 0

    def write(self, desk: Desk) -> None:
        """Write the new rows."""
        if not desk.deeds and len(desk.probes.rows) == self._written:
            return
        while desk.deeds:
            self._deeds.writerow(desk.deeds.popleft())
        self._probes.writerows(desk.probes.rows[self._written :])
        self._written = len(desk.probes.rows)
        for stream in self._streams:
            stream.flush()

    def close(self, desk: Desk) -> None:
        """Write the remaining rows and close the files."""
        self.write(desk)
        for stream in self._streams:
            stream.close()
