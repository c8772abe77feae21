"""The operator without a world: monitors boards in open air, by its own clock, and may command them.

Uses Zenoh, as `process.py`.
"""

import logging
import queue
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deltaswarm_operator.core.base import Base
from deltaswarm_operator.core.command_log import CommandLog
from deltaswarm_operator.core.console import Console
from deltaswarm_operator.core.presence import OpenAirMeter
from deltaswarm_operator.io.bounded_queue import BoundedQueue, ItemKind, sender_of, whose_key
from deltaswarm_operator.io.command_options import CommandOptions
from deltaswarm_operator.io.console_server import ConsoleServer
from deltaswarm_operator.io.files import Output
from deltaswarm_operator.io.page import Page
from deltaswarm_operator.io.process import stop_on_signals
from deltaswarm_scenario.operator_settings import OperatorSettings
from deltaswarm_wire.commands import BASE_ID, Turn
from deltaswarm_wire.envelope import Sent, encode_sent
from deltaswarm_wire.keys import AGENT, RADIO, Keys, parse_token
from deltaswarm_wire.operator_messages import Clock, Report, Workload
from deltaswarm_wire.session import Pairs, RouterLink, configured, use_one_worker_thread

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.operator")

COLUMNS = (*Workload._fields, "agents_alive", "agents_ill")


@dataclass(frozen=True)
class OpenAirConfig:
    """Configuration of the operator without a world."""

    run: str
    link: RouterLink
    pairs: Pairs
    """Settings of the Zenoh session."""
    settings: OperatorSettings
    step_s: float
    out: Path
    status_every_s: float
    """Interval of status lines [s]."""
    command_options: CommandOptions | None = None
    """A console with commands, a station or both."""


WAKES_EVERY_S = 1.0
"""Longest wait of the main thread, so that a signal just before the wait is handled soon."""

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
        commands = self._server.console.command_log.described(self._now_s)
        return {**self._server.totals, "commands": commands, "frames": self.base.frames}

    def finish(self) -> None:
        """Complete and close the tables."""
        self._server.finish()

    def _send(self, turn: Turn) -> None:
        self.base.send(turn.commands, self._now_s)


class OpenAirOperator:
    """The operator over an open session. `station` is the operator's end of the channel, if there is a station."""

    def __init__(
        self,
        config: OpenAirConfig,
        session: zenoh.Session,
        inbox: BoundedQueue,
        output: Output,
        station: socket.socket | None = None,
    ) -> None:
        self.meter = OpenAirMeter(config.settings, config.step_s)
        self._config = config
        self._inbox = inbox
        self._output = output
        self._is_writing = True
        self._warned: set[int | None] = set()
        self._start_s = time.monotonic()
        self._status_due_s = config.status_every_s
        keys = Keys(config.run)
        self._subscribers = [
            session.declare_subscriber(keys.all_reports, self._into_inbox(ItemKind.REPORT)),
            session.declare_subscriber(keys.all_health, self._into_inbox(ItemKind.HEALTH)),
            session.liveliness().declare_subscriber(
                keys.token(AGENT, "*"), self._into_inbox(ItemKind.TOKEN), history=True
            ),
        ]
        self.console: FieldConsole | None = None
        if config.command_options is not None:
            radio = session.declare_publisher(
                keys.agent(BASE_ID, RADIO),
                encoding=zenoh.Encoding("application/msgpack;deltaswarm.Radio.v1"),
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=zenoh.Reliability.BEST_EFFORT,
            )
            self.console = FieldConsole(
                config.run, config.command_options, config.out, radio.put, inbox.put_intent, station
            )

    def _into_inbox(self, arrival: ItemKind) -> Any:
        return zenoh.handlers.Callback(lambda sample: self._inbox.put(arrival, sample), indirect=False)

    @property
    def totals(self) -> dict[str, Any]:
        """The meter's totals, with refused samples per sender."""
        refused = {whose_key(agent): count for agent, count in self._inbox.refused.items()}
        return {**self.meter.totals, "refused_on": refused, **(self.console.totals if self.console else {})}

    def run(self) -> None:
        """Process the inbox and close steps until stopped."""
        while True:
            now_s = self._now_s()
            workload = self.meter.close_second(now_s, len(self._inbox))
            if self.console:
                self.console.advance(now_s, workload)
            if workload is not None:
                self._write((*workload, len(self.meter.alive), len(self.meter.faulty)))
                if now_s >= self._status_due_s:
                    self._status_due_s = now_s + self._config.status_every_s
                    log.info("%s", self._line(workload))
            try:
                arrival, sample = self._inbox.get(self._wait_s(self._now_s()))
            except queue.Empty:
                continue
            if arrival is ItemKind.STOP:
                return
            if arrival is ItemKind.TOKEN:
                self._take_token(sample)
            elif arrival is ItemKind.INTENT:
                self._take_intent(sample)
            else:
                self._take(arrival, sample)

    def _wait_s(self, now_s: float) -> float:
        wait_s = min(WAKES_EVERY_S, self.meter.wait_s(now_s))
        return wait_s if self.console is None else min(wait_s, self.console.wait_s(now_s))

    def _take_intent(self, intent: bytes | None) -> None:
        if intent is None:
            log.warning("the station has ended; the operator continues without it")
        if self.console:
            self.console.on_intent(intent, self._now_s())

    def _write(self, row: Sequence[Any]) -> None:
        """Write a row. A full disk ends the table, but not the status lines."""
        if self._is_writing:
            try:
                self._output.row(row)
            except OSError as error:
                log.error("writing to %s stopped: %s", self._config.out, error)
                self._is_writing = False

    def _now_s(self) -> float:
        return time.monotonic() - self._start_s

    def _line(self, workload: Workload) -> str:
        alive = self.meter.alive
        doubled = self.meter.doubled
        totals = self.meter.totals
        faulty = "; ".join(f"{agent}: {fault}" for agent, fault in self.meter.faulty.items())
        return (
            f"{len(alive)} agents alive ({', '.join(map(str, alive)) or 'nobody'}), "
            + (f"not well ({faulty}), " if faulty else "")
            + (f"doubled ({', '.join(map(str, doubled))}), " if doubled else "")
            + f"{workload.rate_1s_hz:.1f} messages/s, {workload.rate_60s_hz:.1f} over a minute, "
            f"{totals['messages']} in all, {totals['lost']} lost, {self._inbox.refused.total()} refused"
        )

    def _take(self, arrival: ItemKind, sample: zenoh.Sample) -> None:
        agent = sender_of(sample)
        data = sample.payload.to_bytes()
        if arrival is ItemKind.REPORT:
            sent = sample.attachment
            reason = self._take_report(agent, data, None if sent is None else sent.to_bytes())
        else:
            reason = self._take_health(agent, data)
        if reason is not None and agent not in self._warned:
            self._warned.add(agent)
            log.warning("dropped a sample on %s: %s (more are only counted)", whose_key(agent), reason)

    def _take_report(self, agent: int | None, data: bytes, sent: bytes | None) -> str | None:
        before = self.meter.is_doubled(agent)
        reason = self.meter.hear(agent, data, sent, self._now_s())
        if reason is None and agent is not None and self.console:
            self.console.hear(self.meter.agents[agent].newest)
        if (is_doubled := self.meter.is_doubled(agent)) != before:
            what = "several processes report as agent %d: does another board have its number?"
            log.warning(what if is_doubled else "only one process reports as agent %d again", agent)
        return reason

    def _take_health(self, agent: int | None, data: bytes) -> str | None:
        before = self.meter.fault_of(agent)
        reason = self.meter.on_health(agent, data)
        fault = self.meter.fault_of(agent)
        if bool(fault) != bool(before):
            log.warning("agent %d is %s", agent, f"not well: {fault}" if fault else "well")
        return reason

    def _take_token(self, sample: zenoh.Sample) -> None:
        source = parse_token(str(sample.key_expr))
        if source is None:
            return
        is_there = sample.kind == zenoh.SampleKind.PUT
        (self.meter.came if is_there else self.meter.went)(source[1])
        log.info("agent %d is %s", source[1], "present" if is_there else "gone")


def run_open_air(config: OpenAirConfig) -> int:
    """Run the operator until a signal; return the exit code. Call it in the main thread.

    Raises:
        ValueError: the user's own Zenoh settings are refused.
        OSError: the station does not start.
    """
    zenoh.init_log_from_env_or("error")
    inbox = BoundedQueue()
    stop_on_signals(inbox.stop)
    settings = configured(zenoh.Config, config.pairs, config.link)
    listen = config.command_options.listen if config.command_options else None
    with ExitStack() as stack:
        station = None
        if listen is not None:
            page = stack.enter_context(Page(listen))
            station = page.end
            print(page.url, flush=True)
        return _run_session(config, settings, inbox, station)


def _run_session(
    config: OpenAirConfig, settings: zenoh.Config, inbox: BoundedQueue, station: socket.socket | None
) -> int:
    try:
        session = zenoh.open(settings)
    except zenoh.ZError as error:
        log.error("cannot open a session: %s", error)
        return 1
    try:
        with session, Output(config.out, COLUMNS) as output:
            operator = OpenAirOperator(config, session, inbox, output, station)
            log.info("the operator monitors run %s", config.run)
            operator.run()
            totals = operator.totals
            if operator.console:
                operator.console.finish()
            output.finish({"complete": True, "end": "stopped by a signal", "refused": inbox.refused.total(), **totals})
    except OSError as error:
        log.error("the table in %s is incomplete: %s", config.out, error)
        return 1
    log.info("stopped: %d steps, %d messages, %d lost", totals["steps"], totals["messages"], totals["lost"])
    return 0
