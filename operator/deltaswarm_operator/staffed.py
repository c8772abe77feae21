"""The part of the operator's process that serves a desk: turns and pace out, the station's datagrams both ways."""

import json
import socket
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from deltaswarm_operator.channel import Channel
from deltaswarm_operator.deeds import DeedTables
from deltaswarm_operator.desk import Desk
from deltaswarm_wire.commands import Pace, Turn, decode_turn, encode_turn
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from deltaswarm_wire.settings_downlink import FIRST_STEP

SHOW_EVERY_S = 0.1
"""The station gets a picture at most this often [wall s]."""

HELLO_EVERY_S = 1.0
ANSWER_WITHIN_S = 900.0
"""After the last step the person has so long to answer what is still asked [wall s]."""


class StaffedDesk:
    """A desk with its edges.

    Args:
        run: the run's name.
        desk: the desk, before the first step.
        is_awaited: whether the world waits for each turn.
        folder: for the tables of what the person did and answered.
        send_turn, send_pace: take what goes to the world, or on the air.
        on_intent: is called in the channel's thread; `take` then wants the intent in the main one.
        end: the socket pair's end, if there is a station.
        go_on: go on with the tables of an operator that was killed.
    """

    def __init__(
        self,
        run: str,
        desk: Desk,
        folder: Path,
        send_turn: Callable[[Turn], None],
        send_pace: Callable[[Pace], None],
        on_intent: Callable[[bytes | None], None],
        end: socket.socket | None,
        *,
        is_awaited: bool = False,
        go_on: bool = False,
    ) -> None:
        self.desk = desk
        self.is_awaited = is_awaited
        self._run = run
        self._send_turn, self._send_pace = send_turn, send_pace
        self._tables = DeedTables(folder, go_on=go_on)
        self._channel = None if end is None else Channel(end, on_intent)
        self._pace = self.desk.pace
        self._turns: deque[Turn] = deque(maxlen=FIRST_STEP)
        """The newest turns, which the world may not have had when this process was killed."""
        self._show_due = self._hello_due = 0.0

    @property
    def wait_s(self) -> float | None:
        """How long to wait for news before `show` is called again [wall s]; None where nobody watches."""
        return None if self._channel is None else SHOW_EVERY_S

    def begin(self) -> None:
        """Before the first step."""
        self.desk.begin(time.monotonic())
        if self.is_awaited:
            for turn in self._turns:  # the world leaves out those that it has
                self._send_turn(turn)
        if self._channel is not None:
            self._pace = self.desk.pace
            self._send_pace(self._pace)
        self.show()

    def close(self, clock: Clock, workload: Workload, reports: tuple[Report, ...]) -> None:
        """A step is closed; answer with the operator's turn."""
        turn = self.desk.close(clock, workload, reports, time.monotonic())
        if self.is_awaited or turn.commands:
            self._turns.append(turn)
            self._send_turn(turn)
        if clock.last:
            self._show_due = 0.0
        self.show()

    def take(self, intent: bytes | None) -> bool:
        """Do what somebody at the station wants; whether `state` should be saved for it, before `show` tells of it.

        None: the station has gone, and the run goes on without it.
        """
        desk, channel = self.desk, self._channel
        if channel is None:
            return False
        given = len(desk.commander.sent)
        if intent is None:
            self._channel = None
            if desk.pace.hold_step >= 0:  # nobody could let it go on
                desk.pace = desk.pace._replace(hold_step=-1)
        else:
            for answer in desk.intend(intent, time.monotonic()):
                channel.send(answer)
        if not self.is_awaited and (turn := desk.turn()).commands:
            self._send_turn(turn)
        has_news = len(desk.commander.sent) > given or desk.pace != self._pace
        if desk.pace != self._pace:
            self._pace = desk.pace
            self._send_pace(self._pace)
        self._show_due = 0.0
        return has_news

    def show(self) -> None:
        """Send the station a picture, if one is due, and write down what the person did."""
        self._tables.write(self.desk)
        now = time.monotonic()
        if self._channel is None or now < self._show_due:
            return
        self._show_due = now + SHOW_EVERY_S
        if now >= self._hello_due:
            self._hello_due = now + HELLO_EVERY_S
            self._channel.send(self.desk.hello(self._run))
        self._channel.send(self.desk.show(now))

    @property
    def is_asking(self) -> bool:
        """Whether somebody at the station has still something to answer."""
        return self._channel is not None and self.desk.probes.open(time.monotonic()) is not None

    def go_on(self, step: int, state: str | None) -> None:
        """Go on for an operator that was killed after a step."""
        if state is not None:
            found = json.loads(state)
            self.desk.go_on(step, found["desk"])
            self._turns += [decode_turn(bytes.fromhex(turn)) for turn in found["turns"]]

    def state(self) -> str:
        """All that is needed to go on, as JSON: one text, since it may be long and is written often."""
        return json.dumps({"desk": self.desk.state(), "turns": [encode_turn(turn).hex() for turn in self._turns]})

    @property
    def totals(self) -> dict[str, Any]:
        """What the operator's totals have besides the workload."""
        return self.desk.totals

    def finish(self) -> None:
        """Nothing comes any more."""
        self._tables.close(self.desk)
