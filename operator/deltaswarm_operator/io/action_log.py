"""Tables of what the person at the console did, was asked and was shown."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.wall_clock import WallClock
from deltaswarm_scenario.person_tables import TABLES, EventNumberRow, InboxRow, OperatorAction, ProbeRow, WallTimeRow
from deltaswarm_wire.cells import TableWriter

ACTIONS, PROBES, WALL_TIMES = "actions.csv", "probes.csv", "wall_times.csv"


class ActionLog:
    """The tables of one console: rows of acts, answers and steps are written at once, the others at the end.

    With `sizes` it continues the tables of a killed operator, cut back to these lengths [bytes]. Steps have wall times
    if there is a station.
    """

    def __init__(
        self,
        folder: Path,
        sizes: Mapping[str, int] | None = None,
        *,
        has_station: bool = False,
        clock: WallClock | None = None,
    ) -> None:
        self._clock = clock or WallClock()
        for name, size in (sizes or {}).items():
            os.truncate(folder / name, size)
        self.folder = folder
        self._streams = {
            name: (folder / name).open("a" if sizes else "w", newline="", encoding="utf-8")
            for name in (ACTIONS, PROBES, *([WALL_TIMES] if has_station else []))
        }
        self._writers = {name: TableWriter(stream) for name, stream in self._streams.items()}
        if not sizes:
            for name, writer in self._writers.items():
                writer.writerow(TABLES[Path(name).stem]._fields)

    def write(self, console: Console) -> list[OperatorAction | ProbeRow]:
        acts, answers = console.take_actions(), console.probes.take_rows()
        if not acts and not answers:
            return []
        for act in acts:
            self._writers[ACTIONS].writerow(act._replace(utc=self._clock.utc_of(act.monotonic_s)))
        for row in answers:
            asked, answered = map(self._clock.utc_of, (row.asked_monotonic_s, row.answered_monotonic_s))
            self._writers[PROBES].writerow(row._replace(asked_utc=asked, answered_utc=answered))
        self._flush()
        return [*acts, *answers]

    def close_step(self, step: int, time_s: float, monotonic_s: float) -> None:
        self._writers[WALL_TIMES].writerow(WallTimeRow(step, time_s, self._clock.utc_of(monotonic_s), monotonic_s))

    def _flush(self) -> None:
        for stream in self._streams.values():
            stream.flush()

    def sync(self) -> None:
        self._flush()
        for stream in self._streams.values():
            os.fsync(stream.fileno())

    @property
    def sizes(self) -> dict[str, int]:
        return {name: stream.tell() for name, stream in self._streams.items()}

    def close(self, console: Console) -> None:
        self.write(console)
        for stream in self._streams.values():
            stream.close()
        picture = console.picture
        self._whole("inbox", self._inbox(console))
        self._whole("commands", console.command_log.table(picture.now_s))
        self._whole("event_numbers", [EventNumberRow(number, event) for event, number in picture.event_numbers.items()])

    def _whole(self, name: str, rows: Iterable[tuple[Any, ...]]) -> None:
        with (self.folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as stream:
            writer = TableWriter(stream)
            writer.writerow(TABLES[name]._fields)
            writer.writerows(rows)

    def _inbox(self, console: Console) -> Iterable[InboxRow]:
        ledger, attention = console.ledger, console.attention
        for item in ledger.items:
            number, is_shown = item.number, item.number in ledger.shown_s
            shown = None if attention is None else attention.shown_wall_s.get(number)
            read = None if attention is None else attention.read_wall_s.get(number)
            yield InboxRow(
                number,
                item.time_s,
                item.agent,
                item.role,
                item.followers,
                " ".join(map(str, item.events)),
                int(item.is_new),
                self._clock.utc_of(shown),
                shown,
                ledger.read_s.get(number),
                self._clock.utc_of(read),
                read,
                item.news,
                item.severity,
                ledger.shown_s.get(number),
                item.line if is_shown else None,
                int(item.is_quiet) if is_shown else None,
                ledger.why_held(number),
                int(number in ledger.opened),
            )
