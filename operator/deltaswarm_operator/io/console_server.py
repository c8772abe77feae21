"""Serves a console in the operator's process: sends turns and pace, and exchanges datagrams with the station."""

import json
import socket
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.hello import CONDUCTOR_KIND, page_hello
from deltaswarm_operator.core.intents import carry_out
from deltaswarm_operator.io.action_log import ActionLog
from deltaswarm_operator.io.markers import Markers
from deltaswarm_operator.io.wall_clock import WallClock
from deltaswarm_scenario.operator_links import FIRST_STEP
from deltaswarm_scenario.page_messages import MAX_DATAGRAM_BYTES, Message, made
from deltaswarm_scenario.person_tables import CONDUCTOR, PERSON, OperatorAction
from deltaswarm_wire.commands import Pace, Turn
from deltaswarm_wire.operator_messages import Clock, Report, Workload

SHOW_EVERY_S = 0.1
"""Shortest interval between pictures for the station [wall s]."""

HELLO_EVERY_S = 1.0
SEND_BUFFER_BYTES = 1024 * 1024
ANSWER_WITHIN_S = 900.0
"""Time that the person has after the last step to answer open questions [wall s]."""


class Channel:
    """Sends datagrams to the station, and receives its intents.

    `take` is called in a separate thread: with each intent, and with None once the station has closed its end.
    """

    def __init__(self, end: socket.socket, take: Callable[[bytes | None], None]) -> None:
        self.is_muted = False
        """Whether nothing is sent."""
        end.setblocking(True)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._end = end
        self._take = take
        threading.Thread(target=self._receive, daemon=True).start()

    def send(self, message: Message) -> None:
        """Send one message; drop it if the station is behind or gone."""
        if not self.is_muted:
            self.pass_on(json.dumps(message, separators=(",", ":"), allow_nan=False).encode())

    def pass_on(self, datagram: bytes) -> None:
        """The same with a message as it came from another channel."""
        with suppress(OSError):
            self._end.send(datagram, socket.MSG_DONTWAIT)

    def _receive(self) -> None:
        while True:
            try:
                data = self._end.recv(MAX_DATAGRAM_BYTES)
            except OSError:
                data = b""
            self._take(data or None)
            if not data:
                return


@dataclass
class SavedConsole:
    """A console with what its server needs to resume."""

    console: Console
    turns: deque[Turn]
    table_bytes: Mapping[str, int]
    """Lengths of the tables by name."""


@dataclass(frozen=True)
class Outlet:
    """Sends turns and the pace to the world, or on the air; whether each turn is awaited there."""

    send_turn: Callable[[Turn], object]
    send_pace: Callable[[Pace], None]
    is_awaited: bool = False


class ConsoleServer:
    """A console with its inputs and outputs.

    Args:
        run: the run's name.
        console: the console, before the first step, or that of a killed operator to go on from.
        folder: for the tables of the person's acts and answers.
        outlet: where turns and the pace go.
        station, conductor: the channels to the participant's and the conductor's page, if there are any. The main
            thread must pass what they take to `on_intent`.
        markers: where acts and questions are told as they happen.
        clock: tells the wall time.
    """

    def __init__(
        self,
        run: str,
        console: Console | SavedConsole,
        folder: Path,
        outlet: Outlet,
        station: Channel | None = None,
        *,
        conductor: Channel | None = None,
        markers: Markers | None = None,
        clock: WallClock | None = None,
    ) -> None:
        clock = clock or WallClock()
        self._now = clock.now
        saved = console if isinstance(console, SavedConsole) else None
        self.console = console = console.console if isinstance(console, SavedConsole) else console
        self._markers = markers
        self._run = run
        self._outlet = outlet
        self._channel = station
        self._conductor = conductor
        console.attend(has_station=station is not None, has_conductor=conductor is not None)
        if saved is not None:
            console.resume()
        self._pace = self.console.pace
        self._turns: deque[Turn] = saved.turns if saved else deque(maxlen=FIRST_STEP)
        """The newest turns. If this process is killed, its successor repeats them, since the world may lack them."""
        self._answers: list[tuple[Message, str]] = []
        """Answers to inputs, and whose: they are sent once what was done is saved."""
        self._show_due = self._hello_due = 0.0
        sizes = saved.table_bytes if saved else None
        self._tables = ActionLog(folder, sizes, has_station=station is not None, clock=clock)

    @property
    def wait_s(self) -> float | None:
        """Longest wait before `show` is called again [wall s]; None without a station."""
        return None if self._channel is None else SHOW_EVERY_S

    @property
    def is_due(self) -> bool:
        return self._channel is not None and self._now() >= self._show_due

    def start(self) -> None:
        self.console.start(self._now())
        if self._outlet.is_awaited:
            for turn in self._turns:  # the world drops those that it has
                self._outlet.send_turn(turn)
        if self._channel is not None:
            self._pace = self.console.pace
            self._outlet.send_pace(self._pace)
        self.show()

    def close_step(self, clock: Clock, workload: Workload, reports: tuple[Report, ...]) -> None:
        now = self._now()
        turn = self.console.close_step(clock, workload, reports, now)
        if self._channel is not None:
            self._tables.close_step(clock.step, clock.time_s, now)
        if clock.step == 0 or clock.last:
            self._mark(now, {"kind": "end" if clock.last else "begin", "time_s": clock.time_s})
        if self._outlet.is_awaited or turn.commands:
            self._turns.append(turn)
            self._outlet.send_turn(turn)
        if clock.last:
            self._show_due = 0.0
        self.show()

    def on_intent(self, intent: bytes | None, by: str = PERSON) -> bool:
        """Carry out an intent of the participant or the conductor; return whether to save `state` before `show`.

        It must be saved if anything was written down, or else the operator that replaces a killed one cuts it off.
        None: the station has gone, and the run continues without it.
        """
        console, channel = self.console, self._channel
        if channel is None or (intent is None and by == CONDUCTOR):
            return False
        if intent is None:
            self._channel = None
            console.lose_station()
        else:
            self._answers += ((answer, by) for answer in carry_out(console, intent, self._now(), by))
        if not self._outlet.is_awaited and (turn := console.turn()).commands:
            self._outlet.send_turn(turn)
        is_changed = self._write()
        is_changed |= self._pass_on_pace()
        if is_changed or any(answer["type"] != "beat" for answer, _ in self._answers):
            self._show_due = 0.0
        return is_changed

    def _pass_on_pace(self) -> bool:
        """Send the pace to the world if it has changed; return whether it has."""
        if self.console.pace == self._pace:
            return False
        self._pace = self.console.pace
        self._outlet.send_pace(self._pace)
        return True

    def _answer(self) -> None:
        """Answer the inputs that are written down: only the sender of one, unless the answer is for every page."""
        for answer, by in self._answers:
            if by == PERSON and self._channel is not None:
                self._channel.send(answer)
            if self._conductor is not None and (by == CONDUCTOR or "to" not in answer):
                self._conductor.send(answer)
        self._answers.clear()

    def show(self) -> None:
        """Write down the person's acts, answer them, and send the station a picture if one is due."""
        now = self._now()
        self.console.watch_page(now)
        self._pass_on_pace()
        self._write()
        self._answer()
        if self._markers is not None:
            self._markers.serve()
        if self._channel is None or now < self._show_due:
            return
        self._show_due = now + SHOW_EVERY_S
        if now >= self._hello_due:
            self._hello_due = now + HELLO_EVERY_S
            self._channel.send(page_hello(self.console, self._run))
            if self._conductor is not None:
                self._conductor.send(page_hello(self.console, self._run, CONDUCTOR_KIND))
        picture = self.console.show(now)
        self._channel.send(picture)
        if self._conductor is not None:
            self._conductor.send({**picture, "next": self.console.probes.next})

    def speak_anew(self) -> None:
        """Tell the pages at once all that they need: a new one, or one that has waited for a process in its place."""
        self._hello_due = self._show_due = 0.0
        self.show()

    def mark(self, markers: Markers) -> None:
        """From now on, tell acts and questions there."""
        self._markers = markers

    def _write(self) -> bool:
        """Write down new acts and answers, mark them, and tell the conductor; return whether there are any."""
        rows = self._tables.write(self.console)
        if self._conductor is not None:
            for act in self.console.recent_acts.take(rows):
                self._conductor.send(made("act", act=act))
        while self.console.probes.opened:
            asked = self.console.probes.opened.popleft()
            self._mark(asked.asked_monotonic_s, {"kind": "question", "time_s": asked.asked_s, **asked._asdict()})
        for row in rows:
            if isinstance(row, OperatorAction):
                self._mark(row.monotonic_s, row._asdict())
            else:
                kind = "missing" if row.value is None else "answer"
                self._mark(row.answered_monotonic_s, {"kind": kind, **row._asdict()})
        return bool(rows)

    def _mark(self, monotonic_s: float | None, marker: Mapping[str, Any]) -> None:
        if self._markers is not None:
            self._markers.put(monotonic_s, marker)

    @property
    def is_asking(self) -> bool:
        """Whether a question to the person at the station is open, or an input of the run may be on the way."""
        now = self._now()
        is_open = self.console.probes.open(now) is not None or self.console.probes.is_asking
        return self._channel is not None and (is_open or self.console.awaits_page(now))

    def state(self, *, sync: bool = False) -> SavedConsole:
        self._write()
        if sync:
            self._tables.sync()
        return SavedConsole(self.console, self._turns, self._tables.sizes)

    @property
    def table_sizes(self) -> dict[str, int]:
        return self._tables.sizes

    def finish(self) -> None:
        self.console.probes.close()
        self._write()
        self._tables.close(self.console)
        self._answer()
        if self._markers is not None:
            self._markers.close()
