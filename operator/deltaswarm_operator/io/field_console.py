"""A console in open air: commands go out as radio frames of the base, by the operator's own clock."""

import socket
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from deltaswarm_operator.core.base import Base
from deltaswarm_operator.core.command_log import CommandLog
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.io.command_options import CommandOptions
from deltaswarm_operator.io.console_server import ConsoleServer
from deltaswarm_wire.commands import Turn
from deltaswarm_wire.envelope import Sent, encode_sent
from deltaswarm_wire.operator_messages import Clock, Report, Workload

MAX_REPORTS_OF_ONE = 16
"""The console takes this many of one agent's newest reports per step: without admission control anyone may send."""


class FieldConsole:
    """A console with its base. Times count from the operator's start [s].

    Args:
        run: the run's name.
        command_options: settings from the command line.
        folder: for the tables of the person's acts.
        put: publishes a radio frame of the base, with its attachment.
        on_intent: called in the channel's thread; the main thread must then pass the intent to `on_intent`.
        station: the operator's end of the channel, if there is a station.
    """

    def __init__(
        self,
        run: str,
        command_options: CommandOptions,
        folder: Path,
        put: Callable[..., None],
        on_intent: Callable[[bytes | None], None],
        station: socket.socket | None,
    ) -> None:
        started = int(time.time())  # Unix time: a restarted operator numbers frames and commands higher
        self.base = Base(command_options.board_step_s, started)
        self._base_m = command_options.briefing.base_m
        self._step_s = command_options.briefing.step_s
        self._put = put
        self._reports: dict[int, deque[Report]] = {}
        self._now_s = 0.0
        command_log = CommandLog(command_options.briefing.forms, command_options.sign, started)
        console = Console(command_options.briefing, command_log, in_air=True)
        self._server = ConsoleServer(run, console, folder, self._send, lambda pace: None, on_intent, station)
        self._server.start()

    def hear(self, report: Report | None) -> None:
        """Take in an accepted report. It counts when it arrives, since its step is by its board's clock."""
        if report is not None:
            self._reports.setdefault(report.agent, deque(maxlen=MAX_REPORTS_OF_ONE)).append(report)

    def advance(self, now_s: float, workload: Workload | None) -> None:
        """Close the step of this workload, if any; show the picture; send the frame that is due."""
        self._now_s = now_s
        if workload is None:
            self._server.show()
        else:
            arrived = [report._replace(step=workload.step) for of_one in self._reports.values() for report in of_one]
            self._reports.clear()
            self._server.close_step(Clock(workload.step, workload.time_s, False), workload, tuple(arrived))
        frame = self.base.frame(now_s)
        if frame is not None:
            self._put(frame, attachment=encode_sent(Sent(now_s, *self._base_m)) if self._base_m else None)

    def wait_s(self, now_s: float) -> float:
        """Return the longest time until `advance` must be called again [s]."""
        waits = [wait_s for wait_s in (self._server.wait_s, self.base.wait_s(now_s)) if wait_s is not None]
        return min(waits, default=self._step_s)

    def on_intent(self, intent: bytes | None, now_s: float) -> None:
        """Carry out an intent of the station; None: the station has gone."""
        self._now_s = now_s
        self._server.on_intent(intent)
        self._server.show()

    @property
    def totals(self) -> dict[str, Any]:
        """The operator's totals besides the workload."""
        fates = self._server.console.command_log.fates(self._now_s)
        return {**self._server.totals, "commands": fates, "frames": self.base.frames}

    def finish(self) -> None:
        """Complete and close the tables."""
        self._server.finish()

    def _send(self, turn: Turn) -> None:
        self.base.send(turn.commands, self._now_s)
